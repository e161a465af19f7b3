# SPDX-License-Identifier: Apache-2.0
#
# Lets an ordinary ament_cmake package build against the ROS 2 wheels of PyPI.
# Given as CMAKE_PROJECT_TOP_LEVEL_INCLUDES (CMake >= 3.24); not needed where ROS 2 is installed.

# ament_cmake asks the ament index for its extensions, and finds the index through this variable.
find_package(Python3 REQUIRED COMPONENTS Interpreter)
execute_process(
  COMMAND "${Python3_EXECUTABLE}" -c
    "import ament_package; print(ament_package.__file__.rsplit('/lib/', 1)[0])"
  OUTPUT_VARIABLE ros_wheels_prefix
  OUTPUT_STRIP_TRAILING_WHITESPACE
  COMMAND_ERROR_IS_FATAL ANY)
set(ros_wheels_folder "${CMAKE_CURRENT_LIST_DIR}")
set(ENV{AMENT_PREFIX_PATH} "${ros_wheels_prefix}")
list(PREPEND CMAKE_PREFIX_PATH "${ros_wheels_prefix}")

# The wheels export include directories of the machine they were built on; CMake refuses them.
macro(ros_wheels_find method package)
  find_package(${package} ${ARGN} BYPASS_PROVIDER)
  ros_wheels_drop_foreign_includes()
  ros_wheels_generate_for_python()
  ros_wheels_generate_faster()
endmacro()

function(ros_wheels_drop_foreign_includes)
  get_directory_property(targets IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(includes ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(includes)
      list(FILTER includes EXCLUDE REGEX "^/opt/python/")
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${includes}")
    endif()
  endforeach()
endfunction()

# Nodes in Python need no type support for C++.
macro(ros_wheels_generate_for_python)
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE
    REGEX "^rosidl_(generator|typesupport|typesupport_fastrtps|typesupport_introspection)_cpp:")
endmacro()

# Each generator is a program that parses all interfaces, and uses one core.
macro(ros_wheels_generate_faster)
  foreach(name IN ITEMS
      generator_c generator_py generator_type_description
      typesupport_c typesupport_fastrtps_c typesupport_introspection_c)
    if(rosidl_${name}_BIN MATCHES "^[^;]+$")
      list(PREPEND rosidl_${name}_BIN "${ros_wheels_folder}/generate.py")
    endif()
  endforeach()
endmacro()

cmake_language(SET_DEPENDENCY_PROVIDER ros_wheels_find SUPPORTED_METHODS FIND_PACKAGE)

# The files that are generated for each interface are small and share large headers, so they are
# compiled together, except those that define the same names.
function(ros_wheels_compile_together)
  set(prefix "${PROJECT_NAME}__rosidl")
  if(NOT TARGET ${prefix}_generator_c)
    return() # no interfaces in this package
  endif()

  get_target_property(sources ${prefix}_generator_c SOURCES)
  list(FILTER sources INCLUDE REGEX "__description\\.c$")
  set_source_files_properties(${sources} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
endfunction()

set(CMAKE_UNITY_BUILD ON)
set(CMAKE_UNITY_BUILD_BATCH_SIZE 20)
cmake_language(DEFER CALL ros_wheels_compile_together)
