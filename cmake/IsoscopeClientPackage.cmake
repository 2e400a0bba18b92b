# The C++ client as a package for other projects: one archive, its headers, and isoscopeConfig.cmake. Component
# `client`.
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

# Sets `libraries` to our libraries that `target` needs, itself included, and `others` to what they need besides.
function(isoscope_link_closure target libraries others)
  set(todo ${target})
  set(ours "")
  set(theirs "")
  while(todo)
    list(POP_FRONT todo item)
    if(item MATCHES "^isoscope" AND TARGET "${item}")
      get_target_property(aliased "${item}" ALIASED_TARGET)
      if(aliased)
        set(item "${aliased}")
      endif()
      if(NOT item IN_LIST ours)
        list(APPEND ours "${item}")
        get_target_property(type "${item}" TYPE)
        set(property LINK_LIBRARIES)
        if(type STREQUAL INTERFACE_LIBRARY)
          set(property INTERFACE_LINK_LIBRARIES)
        endif()
        get_target_property(needed "${item}" ${property})
        if(needed)
          list(APPEND todo ${needed})
        endif()
      endif()
    elseif(NOT item IN_LIST theirs)
      list(APPEND theirs "${item}")
    endif()
  endwhile()
  list(SORT theirs)
  set(${libraries} ${ours} PARENT_SCOPE)
  set(${others} ${theirs} PARENT_SCOPE)
endfunction()

# Sets `headers` to those of this repository that the given ones include, themselves included.
function(isoscope_include_closure headers)
  set(todo ${ARGN})
  set(found "")
  while(todo)
    list(POP_FRONT todo header)
    if(NOT header IN_LIST found AND EXISTS "${PROJECT_SOURCE_DIR}/${header}")
      list(APPEND found "${header}")
      file(STRINGS "${PROJECT_SOURCE_DIR}/${header}" lines REGEX "^#include \"")
      list(TRANSFORM lines REPLACE "^#include \"([^\"]*)\".*" "\\1")
      list(APPEND todo ${lines})
    endif()
  endwhile()
  set(${headers} ${found} PARENT_SCOPE)
endfunction()

isoscope_link_closure(isoscope::client_connection client_libraries client_needs)
set(client_objects "")
foreach(library IN LISTS client_libraries)
  get_target_property(type ${library} TYPE)
  if(type STREQUAL STATIC_LIBRARY)
    list(APPEND client_objects "$<TARGET_OBJECTS:${library}>")
  endif()
endforeach()
# Header-only libraries that no public header includes.
list(REMOVE_ITEM client_needs CLI11::CLI11 nlohmann_json::nlohmann_json)
# Names of the pkg-config libraries in isoscopeConfig.cmake, distinct from a project's own names.
list(TRANSFORM client_needs REPLACE "^PkgConfig::(.*)"
  "$<BUILD_INTERFACE:PkgConfig::\\1>;$<INSTALL_INTERFACE:PkgConfig::isoscope_\\1>")

# With the version of the commit, as in the programs.
list(TRANSFORM client_objects REPLACE "(.*TARGET_OBJECTS:isoscope_base.*)" "$<FILTER:\\1,EXCLUDE,/version\\\\.cc>")
add_library(isoscope_client STATIC ${client_objects} $<TARGET_OBJECTS:isoscope_program_version>)
add_library(isoscope::client ALIAS isoscope_client)
set_target_properties(isoscope_client PROPERTIES LINKER_LANGUAGE CXX EXPORT_NAME client)
target_compile_features(isoscope_client INTERFACE cxx_std_20)
# Inline functions of the headers compute what the archive's copies compute (IsoscopeCompilerOptions.cmake).
target_compile_options(isoscope_client INTERFACE -ffp-contract=off)
set_property(TARGET isoscope_client PROPERTY INTERFACE_LINK_LIBRARIES "${client_needs}")

# Public headers are those of the client's rooms, without headers that expose gRPC or JSON.
file(GLOB client_headers CONFIGURE_DEPENDS RELATIVE "${PROJECT_SOURCE_DIR}" "${PROJECT_SOURCE_DIR}/clients/cpp/*/*.h")
list(REMOVE_ITEM client_headers clients/cpp/connection/coordinator_channel.h clients/cpp/request/json_text.h)
isoscope_include_closure(client_headers ${client_headers} core/base/status_macros.h)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${client_headers})
set(client_include_folder "${CMAKE_INSTALL_INCLUDEDIR}/isoscope")
foreach(header IN LISTS client_headers)
  get_filename_component(folder "${header}" DIRECTORY)
  install(FILES "${header}" DESTINATION "${client_include_folder}/${folder}" COMPONENT client)
endforeach()
install(DIRECTORY "${PROJECT_BINARY_DIR}/proto/generated/isoscope/v1" DESTINATION "${client_include_folder}/isoscope"
  COMPONENT client FILES_MATCHING PATTERN "*.pb.h" PATTERN "*.grpc.pb.h" EXCLUDE)

set(client_package_folder "${CMAKE_INSTALL_LIBDIR}/cmake/isoscope")
install(TARGETS isoscope_client EXPORT isoscope_client
  ARCHIVE DESTINATION "${CMAKE_INSTALL_LIBDIR}" COMPONENT client
  INCLUDES DESTINATION "${client_include_folder}")
install(EXPORT isoscope_client NAMESPACE isoscope:: FILE isoscopeTargets.cmake
  DESTINATION "${client_package_folder}" COMPONENT client)
configure_package_config_file("${PROJECT_SOURCE_DIR}/cmake/isoscopeConfig.cmake.in"
  "${PROJECT_BINARY_DIR}/isoscopeConfig.cmake" INSTALL_DESTINATION "${client_package_folder}")
write_basic_package_version_file("${PROJECT_BINARY_DIR}/isoscopeConfigVersion.cmake" COMPATIBILITY ExactVersion)
install(FILES "${PROJECT_BINARY_DIR}/isoscopeConfig.cmake" "${PROJECT_BINARY_DIR}/isoscopeConfigVersion.cmake"
  DESTINATION "${client_package_folder}" COMPONENT client)
