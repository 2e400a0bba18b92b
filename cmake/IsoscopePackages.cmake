# Debian packages by CPack. scripts/package.sh runs it, and sets the values that change with every package
# (cmake/PackageOptions.cmake).
#
#   isoscope         component `programs`, with units, their user and folders
#   isoscope-dev     component `client`: find_package(isoscope)
#   python3-isoscope component `python`, which scripts/package.sh makes of the wheel
#
# A plain `cmake --install` omits files that only a package has.
set(package_folder "${PROJECT_BINARY_DIR}/package")

# Units with the paths of a package.
set(unit_folder "${package_folder}/systemd")
file(GLOB units CONFIGURE_DEPENDS RELATIVE "${PROJECT_SOURCE_DIR}/deploy/systemd"
  "${PROJECT_SOURCE_DIR}/deploy/systemd/*.service")
foreach(unit IN LISTS units)
  file(READ "${PROJECT_SOURCE_DIR}/deploy/systemd/${unit}" text)
  string(REPLACE "/usr/local/bin/" "/usr/bin/" text "${text}")
  file(CONFIGURE OUTPUT "${unit_folder}/${unit}" CONTENT "${text}" @ONLY)
  install(FILES "${unit_folder}/${unit}" DESTINATION lib/systemd/system COMPONENT programs EXCLUDE_FROM_ALL)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${PROJECT_SOURCE_DIR}/deploy/systemd/${unit}")
endforeach()
install(FILES deploy/systemd/isoscope.sysusers DESTINATION lib/sysusers.d RENAME isoscope.conf
  COMPONENT programs EXCLUDE_FROM_ALL)
install(FILES deploy/systemd/isoscope.tmpfiles DESTINATION lib/tmpfiles.d RENAME isoscope.conf
  COMPONENT programs EXCLUDE_FROM_ALL)
install(DIRECTORY deploy/systemd/env DESTINATION share/isoscope COMPONENT programs EXCLUDE_FROM_ALL)
install(FILES deploy/systemd/isoscope-agent-gpu.conf DESTINATION share/isoscope COMPONENT programs EXCLUDE_FROM_ALL)
install(PROGRAMS scripts/make_certificates.sh DESTINATION share/isoscope COMPONENT programs EXCLUDE_FROM_ALL)
install(FILES cmake/debian/README.Debian DESTINATION share/doc/isoscope COMPONENT programs EXCLUDE_FROM_ALL)
install(DIRECTORY clients/cpp/example/ DESTINATION share/doc/isoscope-dev/examples COMPONENT client EXCLUDE_FROM_ALL)
install(DIRECTORY "${package_folder}/python/" DESTINATION lib/python3/dist-packages COMPONENT python EXCLUDE_FROM_ALL)
# changelogs, compressed without the time, and who may copy it.
foreach(pair IN ITEMS programs=isoscope client=isoscope-dev python=python3-isoscope)
  string(REPLACE "=" ";" pair "${pair}")
  list(GET pair 0 component)
  list(GET pair 1 name)
  install(FILES "${package_folder}/changelog.gz" "${package_folder}/${name}/changelog.Debian.gz" cmake/debian/copyright
    DESTINATION "share/doc/${name}" COMPONENT ${component} EXCLUDE_FROM_ALL
    OPTIONAL)  # `cmake --install --component client` finds no changelog, and needs none
endforeach()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME isoscope)
set(CPACK_PACKAGE_VENDOR Isoscope)
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")  # each has its own: the first line of its description
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_COMPONENTS_ALL programs client python)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_PRE_BUILD_SCRIPTS "${PROJECT_SOURCE_DIR}/cmake/CompressManuals.cmake")
set(CPACK_PROJECT_CONFIG_FILE "${PROJECT_SOURCE_DIR}/cmake/PackageOptions.cmake")

set(CPACK_DEBIAN_PROGRAMS_PACKAGE_NAME isoscope)
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_DEPENDS "adduser")
# OpenGL is opened at run time; without it, programs draw by the CPU. The filters of HDF5 are plugins.
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_RECOMMENDS
  "ca-certificates, fonts-dejavu-core, libegl1, libopengl0, libgl1-mesa-dri, openssl"
  "hdf5-filter-plugin, hdf5-filter-plugin-blosc-serial, hdf5-filter-plugin-zfp-serial, hdf5-plugin-lzf")
list(JOIN CPACK_DEBIAN_PROGRAMS_PACKAGE_RECOMMENDS ", " CPACK_DEBIAN_PROGRAMS_PACKAGE_RECOMMENDS)
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_SUGGESTS "python3-isoscope, gnuplot-nox")
set(CPACK_COMPONENT_PROGRAMS_DESCRIPTION "isosurfaces of volumes too large for one machine
isoscope cuts, views, renders and exports volumes on one machine.
isoscope-agent, isoscope-coordinator and isoscope-gateway are the same as a
service of many machines, and isoscope-bench measures it.

Units of systemd come along, hardened, with a user of their own. Installation
neither enables nor starts them: /usr/share/doc/isoscope/README.Debian.")
set(maintainer_scripts "${PROJECT_SOURCE_DIR}/cmake/debian/programs")
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_CONTROL_EXTRA
  "${maintainer_scripts}/postinst;${maintainer_scripts}/prerm;${maintainer_scripts}/postrm")

# The packages of cmake/isoscopeConfig.cmake and of the headers.
set(CPACK_DEBIAN_CLIENT_PACKAGE_NAME isoscope-dev)
set(CPACK_DEBIAN_CLIENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_CLIENT_PACKAGE_DEPENDS
  "libabsl-dev, libgrpc++-dev, libhwy-dev, libisal-dev, libjpeg-dev, liblz4-dev, libmeshoptimizer-dev, libpango1.0-dev"
  "libpng-dev, libprotobuf-dev, libspdlog-dev, libssl-dev, libtbb-dev, liburing-dev, libwebp-dev, libzstd-dev"
  "pkg-config, protobuf-compiler, protobuf-compiler-grpc, zlib1g-dev")
list(JOIN CPACK_DEBIAN_CLIENT_PACKAGE_DEPENDS ", " CPACK_DEBIAN_CLIENT_PACKAGE_DEPENDS)
set(CPACK_DEBIAN_CLIENT_PACKAGE_SUGGESTS "cmake, isoscope")
set(CPACK_COMPONENT_CLIENT_DESCRIPTION "client of Isoscope for C++ programs
Pictures, planes, picks and meshes of isosurfaces from an Isoscope server:
a static library with its headers, for find_package(isoscope) of CMake. The
library belongs to the compiler and the libraries of this release of Debian.")

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-isoscope)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
  "python3 (>= 3.10), python3-grpcio (>= 1.51~), python3-protobuf (>= 3.21), python3-numpy (>= 1:1.22)")
set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS "isoscope")
set(CPACK_COMPONENT_PYTHON_DESCRIPTION "client of Isoscope for Python
Pictures, depth, normals, picks and meshes of isosurfaces from an Isoscope
server as numpy arrays, in scripts and notebooks, with an asyncio twin.")
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA
  "${PROJECT_SOURCE_DIR}/cmake/debian/python/postinst;${PROJECT_SOURCE_DIR}/cmake/debian/python/prerm")
include(CPack)
