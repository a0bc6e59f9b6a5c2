# Every third-party library, found once, as an imported target. All are Debian 12 packages: scripts/deps.sh.

find_package(PkgConfig REQUIRED)
find_package(Threads REQUIRED)
find_package(OpenMP REQUIRED COMPONENTS C)
find_package(embree 3.13 REQUIRED)

pkg_check_modules(uv REQUIRED IMPORTED_TARGET libuv)
pkg_check_modules(websockets REQUIRED IMPORTED_TARGET libwebsockets>=4.1)
pkg_check_modules(protobuf_c REQUIRED IMPORTED_TARGET libprotobuf-c)
pkg_check_modules(crypto REQUIRED IMPORTED_TARGET libcrypto>=3)
pkg_check_modules(zstd REQUIRED IMPORTED_TARGET libzstd)
pkg_check_modules(xxhash REQUIRED IMPORTED_TARGET libxxhash)
pkg_check_modules(openexr REQUIRED IMPORTED_TARGET OpenEXR)
pkg_check_modules(png REQUIRED IMPORTED_TARGET libpng)
find_package(JPEG REQUIRED) # libjpeg-turbo: JPEG::JPEG
find_package(meshoptimizer 0.18 REQUIRED) # meshoptimizer::meshoptimizer
pkg_check_modules(draco REQUIRED IMPORTED_TARGET draco>=1.5)
pkg_check_modules(webp REQUIRED IMPORTED_TARGET libwebp)
pkg_check_modules(avif REQUIRED IMPORTED_TARGET libavif>=0.11)
pkg_check_modules(assimp REQUIRED IMPORTED_TARGET assimp>=5.2)
pkg_check_modules(inih REQUIRED IMPORTED_TARGET inih)
pkg_check_modules(jansson REQUIRED IMPORTED_TARGET jansson)
pkg_check_modules(sdl2 REQUIRED IMPORTED_TARGET sdl2)
pkg_check_modules(epoxy REQUIRED IMPORTED_TARGET epoxy) # finds the functions of OpenGL and EGL when they are called
pkg_check_modules(cmocka REQUIRED IMPORTED_TARGET cmocka)
find_program(PROTOC_C protoc-c REQUIRED)
find_path(STB_INCLUDE_DIR stb_rect_pack.h PATH_SUFFIXES stb REQUIRED)

# OpenEXR's pkg-config file names the C++ library too; we use the C core alone.
find_library(OPENEXR_CORE_LIBRARY NAMES OpenEXRCore-3_1 OpenEXRCore REQUIRED)
add_library(openexr_core INTERFACE)
add_library(OpenEXR::Core ALIAS openexr_core)
target_include_directories(openexr_core SYSTEM INTERFACE ${openexr_INCLUDE_DIRS})
target_link_libraries(openexr_core INTERFACE ${OPENEXR_CORE_LIBRARY})

add_library(stb INTERFACE)
add_library(stb::stb ALIAS stb)
target_include_directories(stb SYSTEM INTERFACE ${STB_INCLUDE_DIR})
find_library(M_LIBRARY m)
target_link_libraries(stb INTERFACE ${M_LIBRARY})

add_library(uv::uv ALIAS PkgConfig::uv)
add_library(websockets::websockets ALIAS PkgConfig::websockets)
add_library(protobuf_c::protobuf_c ALIAS PkgConfig::protobuf_c)
add_library(openssl::crypto ALIAS PkgConfig::crypto)
add_library(zstd::zstd ALIAS PkgConfig::zstd)
add_library(xxhash::xxhash ALIAS PkgConfig::xxhash)
add_library(draco::cpp ALIAS PkgConfig::draco)
add_library(webp::webp ALIAS PkgConfig::webp)
add_library(avif::avif ALIAS PkgConfig::avif)
add_library(PNG::png ALIAS PkgConfig::png)
add_library(assimp::c ALIAS PkgConfig::assimp) # its C interface; Debian's own CMake target names a config we lack
add_library(inih::inih ALIAS PkgConfig::inih)
add_library(jansson::jansson ALIAS PkgConfig::jansson)
add_library(SDL2::sdl2 ALIAS PkgConfig::sdl2)
add_library(epoxy::epoxy ALIAS PkgConfig::epoxy)
add_library(cmocka::cmocka ALIAS PkgConfig::cmocka)
