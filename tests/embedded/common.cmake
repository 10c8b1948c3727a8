# What both sides need to know: the cases, the boards, the tests.
find_package(Python3 REQUIRED COMPONENTS Interpreter)

# cases/<case>.c runs on the host and on every target.
set(EMBEDDED_CASES math linalg ekf high_gain_ekf example)
set(EMBEDDED_TARGETS m4f m7)
set(EMBEDDED_MACHINE_m4f mps2-an386)
set(EMBEDDED_MACHINE_m7 mps2-an500)

# Expected values become C tables: an image has no files to read.
set(generated ${CMAKE_CURRENT_BINARY_DIR}/golden)
set(here ${CMAKE_CURRENT_SOURCE_DIR})
set(run ${CMAKE_SOURCE_DIR}/tests/golden/adaptive_high_gain_ekf/run_ch2_cont_ahg.json)
file(MAKE_DIRECTORY ${generated})
add_custom_command(OUTPUT ${generated}/golden_high_gain.h
  COMMAND ${Python3_EXECUTABLE} ${here}/golden/high_gain_table.py ${run} 240
          ${generated}/golden_high_gain.h
  DEPENDS ${run} golden/high_gain_table.py VERBATIM)
add_custom_command(OUTPUT ${generated}/golden_ekf.h
  COMMAND ${Python3_EXECUTABLE} ${here}/golden/ekf_table.py ${generated}/golden_ekf.h
  DEPENDS golden/ekf_table.py VERBATIM)
add_custom_target(embedded_golden DEPENDS ${generated}/golden_high_gain.h ${generated}/golden_ekf.h)

# Sources that several cases share, and the program of README.md, compiled as a user would.
set(EMBEDDED_SHARED cases/report.c cases/cstr2_network.c example_microcontroller.c)
set_source_files_properties(example_microcontroller.c PROPERTIES
  COMPILE_OPTIONS -Wno-unused-parameter)
set(EMBEDDED_INCLUDES ${here}/cases ${CMAKE_SOURCE_DIR}/tests/unit ${generated})

# The tests of the cross build in `images`. `reference` is the folder of the same cases built for the
# host, or empty: then images only run and check themselves.
function(embedded_tests images reference fixture)
  set(python ${Python3_EXECUTABLE})
  set(checks ${CMAKE_CURRENT_SOURCE_DIR}/checks)
  set(sizes ${python} ${checks}/sizes.py)
  foreach(target ${EMBEDDED_TARGETS})
    set(machine ${EMBEDDED_MACHINE_${target}})
    foreach(case ${EMBEDDED_CASES})
      set(like "")
      if(reference)
        set(like --like ${reference}/embedded_${case})
      endif()
      embedded_test(${target}/${case} "${fixture}"
                    ${python} ${checks}/run_image.py ${machine} ${images}/${case}_${target} ${like})
    endforeach()
    embedded_test(${target}/library_needs_no_system "${fixture}"
                  ${python} ${checks}/symbols.py ${images}/libdse_${target}.a)
    set(stack ${python} ${checks}/stack.py --machine ${machine} --image ${images}/stack_${target}
              --headers ${CMAKE_SOURCE_DIR}/lib/include/dse
              --graph ${images}/CMakeFiles/dse_${target}.dir
              --graph ${images}/CMakeFiles/stack_${target}.dir)
    embedded_test(${target}/stack "${fixture}" ${stack})
    list(APPEND sizes ${target}=${images}/libdse_${target}.a)
    list(APPEND tables COMMAND ${stack})
  endforeach()
  embedded_test(sizes "${fixture}" ${sizes})
  # The tables of both tests, for whoever wants to read them.
  add_custom_target(embedded-size COMMAND ${sizes} ${tables} VERBATIM USES_TERMINAL)
endfunction()

function(embedded_test name fixture)
  add_test(NAME embedded/${name} COMMAND ${ARGN})
  set_tests_properties(embedded/${name} PROPERTIES LABELS embedded TIMEOUT 180
                       FIXTURES_REQUIRED "${fixture}" SKIP_RETURN_CODE 77)
endfunction()
