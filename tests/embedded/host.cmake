# The host's side: the same cases as host programs, and tests that build and run the images.
embedded_library(dse_single float)
set(library_double dse)
set(library_float dse_single)
foreach(real double float)
  foreach(case ${EMBEDDED_CASES})
    set(name embedded_${case}_${real})
    add_executable(${name} cases/${case}.c ${EMBEDDED_WITH_${case}} host/platform.c
                   ${EMBEDDED_SHARED})
    add_dependencies(${name} embedded_golden)
    target_include_directories(${name} PRIVATE ${EMBEDDED_INCLUDES})
    target_link_libraries(${name} PRIVATE ${library_${real}} dse_warnings)
  endforeach()
endforeach()

find_program(ARM_COMPILER arm-none-eabi-gcc)
find_program(ARM_EMULATOR qemu-system-arm)
if(NOT ARM_COMPILER OR NOT ARM_EMULATOR)
  add_test(NAME embedded/all COMMAND sh -c
           "echo 'arm-none-eabi-gcc or qemu-system-arm is missing: tools/setup installs both'; exit 77")
  set_tests_properties(embedded/all PROPERTIES LABELS embedded SKIP_RETURN_CODE 77)
  return()
endif()

set(cross ${CMAKE_BINARY_DIR}/embedded)
set(build ${CMAKE_CTEST_COMMAND}
  --build-and-test ${CMAKE_SOURCE_DIR} ${cross} --build-generator Ninja --build-noclean
  --build-options -DCMAKE_TOOLCHAIN_FILE=${CMAKE_CURRENT_SOURCE_DIR}/arm-none-eabi.cmake
                  -DCMAKE_BUILD_TYPE=MinSizeRel)
add_test(NAME embedded/build COMMAND ${build})
set_tests_properties(embedded/build PROPERTIES LABELS embedded TIMEOUT 600
                     FIXTURES_SETUP embedded_build)
embedded_tests(${cross}/tests/embedded ${CMAKE_CURRENT_BINARY_DIR} embedded_build)
add_custom_target(embedded-build COMMAND ${build} VERBATIM)
add_dependencies(embedded-size embedded-build)
