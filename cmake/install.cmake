# What `make install` adds to the programs: liblightwell for other people's renderers (docs/client_guide.md),
# and documents.

include(GNUInstallDirs)
set(lw_include_dir ${CMAKE_INSTALL_INCLUDEDIR}/lightwell-${PROJECT_VERSION})

# Headers include each other by their place in this tree, so they keep it, in a folder of their own.
install(FILES client/include/lightwell/client.h DESTINATION ${lw_include_dir}/lightwell COMPONENT client)
foreach(header common/clock.h common/status.h common/vec.h common/scene/scene.h common/scene/scene_change.h common/tile/atlas.h)
  get_filename_component(folder ${header} DIRECTORY)
  install(FILES ${header} DESTINATION ${lw_include_dir}/${folder} COMPONENT client)
endforeach()

install(TARGETS lightwell lw_proto lw_proto_generated lw_tile lw_scene lw_base
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT client)

# From the file's own folder to the prefix: what is installed may be moved.
file(RELATIVE_PATH lw_to_prefix /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
string(REGEX REPLACE "/$" "" lw_to_prefix ${lw_to_prefix})
configure_file(cmake/lightwell.pc.in ${PROJECT_BINARY_DIR}/lightwell.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/lightwell.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT client)

# Documents name each other by their place in this tree, so they keep it, too.
install(FILES LICENSE README.md CHANGELOG.md CONTRIBUTING.md DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(FILES proto/lightwell.proto proto/wire_format.md DESTINATION ${CMAKE_INSTALL_DOCDIR}/proto)
install(DIRECTORY docs DESTINATION ${CMAKE_INSTALL_DOCDIR})
