# What `make install` adds to the programs: liblightwell for other people's renderers (docs/client_guide.md),
# manual pages and documents.

include(CMakePackageConfigHelpers)

install(FILES client/include/lightwell/lightwell.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/lightwell COMPONENT client)
install(TARGETS lightwell_shared EXPORT lightwell LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT client)
install(FILES ${PROJECT_BINARY_DIR}/lib/liblightwell.a DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT client)

# find_package(lightwell)
set(lw_cmake_dir ${CMAKE_INSTALL_LIBDIR}/cmake/lightwell)
configure_package_config_file(cmake/lightwellConfig.cmake.in ${PROJECT_BINARY_DIR}/lightwellConfig.cmake
  INSTALL_DESTINATION ${lw_cmake_dir} PATH_VARS CMAKE_INSTALL_INCLUDEDIR CMAKE_INSTALL_LIBDIR)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/lightwellConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/lightwellConfig.cmake ${PROJECT_BINARY_DIR}/lightwellConfigVersion.cmake
  DESTINATION ${lw_cmake_dir} COMPONENT client)
install(EXPORT lightwell FILE lightwellTargets.cmake NAMESPACE lightwell:: DESTINATION ${lw_cmake_dir} COMPONENT client)

# pkg-config: from the file's own folder to the prefix, as what is installed may be moved.
file(RELATIVE_PATH lw_to_prefix /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
string(REGEX REPLACE "/$" "" lw_to_prefix ${lw_to_prefix})
configure_file(cmake/lightwell.pc.in ${PROJECT_BINARY_DIR}/lightwell.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/lightwell.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT client)

# The service: where systemd looks below /usr/local and /usr.
install(FILES packaging/systemd/lightwelld.service packaging/systemd/lightwell-relay@.service DESTINATION lib/systemd/system)
install(FILES packaging/systemd/lightwelld.conf packaging/systemd/lightwell-relay.conf DESTINATION ${CMAKE_INSTALL_DOCDIR}/systemd)
install(DIRECTORY packaging/prometheus packaging/grafana DESTINATION ${CMAKE_INSTALL_DOCDIR})

# Documents name each other by their place in this tree, so they keep it, too.
install(FILES LICENSE README.md CHANGELOG.md CONTRIBUTING.md SECURITY.md DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(FILES proto/lightwell.proto proto/wire_format.md DESTINATION ${CMAKE_INSTALL_DOCDIR}/proto)
install(DIRECTORY docs examples DESTINATION ${CMAKE_INSTALL_DOCDIR})
