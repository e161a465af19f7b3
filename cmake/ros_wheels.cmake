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
set(ENV{AMENT_PREFIX_PATH} "${ros_wheels_prefix}")
list(PREPEND CMAKE_PREFIX_PATH "${ros_wheels_prefix}")

# The wheels export include directories of the machine they were built on; CMake refuses them.
macro(ros_wheels_find method package)
  find_package(${package} ${ARGN} BYPASS_PROVIDER)
  ros_wheels_drop_foreign_includes()
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

cmake_language(SET_DEPENDENCY_PROVIDER ros_wheels_find SUPPORTED_METHODS FIND_PACKAGE)

# The files that are generated for each interface are small and share large headers: most of them
# are compiled together. Some generators repeat names from file to file, theirs are not.
function(ros_wheels_compile_apart)
  foreach(generator IN ITEMS rosidl_generator_c rosidl_typesupport_introspection_cpp)
    if(TARGET ${PROJECT_NAME}__${generator})
      set_target_properties(${PROJECT_NAME}__${generator} PROPERTIES UNITY_BUILD OFF)
    endif()
  endforeach()
endfunction()

set(CMAKE_UNITY_BUILD ON)
set(CMAKE_UNITY_BUILD_BATCH_SIZE 16)
cmake_language(DEFER CALL ros_wheels_compile_apart)
