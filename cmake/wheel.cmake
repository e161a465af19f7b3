# SPDX-License-Identifier: Apache-2.0
#
# What the wheel holds besides the interfaces and the Python packages: the data packages and the
# entries of the ament index. `colcon build` installs the same from each package's own files.

install(FILES "${CMAKE_CURRENT_LIST_DIR}/bt_agents_ament_prefix.pth"
  DESTINATION "${SKBUILD_PLATLIB_DIR}")

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
  elseif(NOT SKBUILD_STATE STREQUAL "editable") # there, scripts/setup.bash links the folder
    install(DIRECTORY "${folder}/" DESTINATION share/${name}
      FILES_MATCHING PATTERN "*.yaml" PATTERN "package.xml")
  endif()
endforeach()
