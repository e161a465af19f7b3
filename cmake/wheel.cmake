# SPDX-License-Identifier: Apache-2.0
#
# What the wheel holds besides the interfaces and the Python packages: the data packages, the
# entries of the ament index, and the executables where `ros2 run` and `ros2 launch` look for them.
# `colcon build` installs the same from each package's own files.

install(FILES "${CMAKE_CURRENT_LIST_DIR}/bt_agents_ament_prefix.pth"
  DESTINATION "${SKBUILD_PLATLIB_DIR}")

# Installs a script for each entry of `console_scripts`, which runs it with the Python of the prefix.
function(bt_agents_install_executables package setup)
  file(READ "${setup}" text)
  string(REGEX MATCH "\"console_scripts\": \\[[^]]*" scripts "${text}")
  string(REGEX MATCHALL "\"[^\" ]+ = [^\"]+\"" entries "${scripts}")
  foreach(entry IN LISTS entries)
    string(REGEX REPLACE "\"(.+) = (.+):(.+)\"" "\\1;\\2;\\3" entry "${entry}")
    list(POP_FRONT entry executable module function)
    configure_file("${CMAKE_CURRENT_FUNCTION_LIST_DIR}/executable.in"
      "${CMAKE_BINARY_DIR}/executables/${package}/${executable}" @ONLY)
    install(PROGRAMS "${CMAKE_BINARY_DIR}/executables/${package}/${executable}"
      DESTINATION lib/${package})
  endforeach()
endfunction()

file(GLOB manifests CONFIGURE_DEPENDS "${CMAKE_CURRENT_LIST_DIR}/../*/package.xml")
foreach(manifest IN LISTS manifests)
  file(STRINGS "${manifest}" name REGEX "<name>")
  string(REGEX REPLACE ".*<name>(.*)</name>.*" "\\1" name "${name}")
  cmake_path(GET manifest PARENT_PATH folder)
  if(name STREQUAL CMAKE_PROJECT_NAME)
    continue() # ament_package() does it
  endif()

  file(WRITE "${CMAKE_BINARY_DIR}/ament_index/${name}" "")
  install(FILES "${CMAKE_BINARY_DIR}/ament_index/${name}"
    DESTINATION share/ament_index/resource_index/packages)
  if(EXISTS "${folder}/setup.py")
    install(FILES "${manifest}" DESTINATION share/${name})
    file(GLOB layouts CONFIGURE_DEPENDS "${folder}/${name}/foxglove/*.json")
    install(FILES ${layouts} DESTINATION share/${name}/foxglove)
    bt_agents_install_executables(${name} "${folder}/setup.py")
  elseif(NOT BT_AGENTS_OF_CHECKOUT) # there, scripts/setup.bash links the folder
    install(DIRECTORY "${folder}/" DESTINATION share/${name}
      FILES_MATCHING PATTERN "*.yaml" PATTERN "package.xml")
  endif()
endforeach()
