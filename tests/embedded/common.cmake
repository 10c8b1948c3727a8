# What both sides need to know: the cases, the boards, the tests.
find_package(Python3 REQUIRED COMPONENTS Interpreter)

# cases/<case>.c runs on the host and on every target; it may use its data and the unit tests'.
set(EMBEDDED_CASES math linalg)
set(EMBEDDED_TARGETS m4f m7)
set(EMBEDDED_MACHINE_m4f mps2-an386)
set(EMBEDDED_MACHINE_m7 mps2-an500)

set(EMBEDDED_REPORT ${CMAKE_CURRENT_SOURCE_DIR}/cases/report.c)
set(EMBEDDED_INCLUDES ${CMAKE_CURRENT_SOURCE_DIR}/cases ${CMAKE_SOURCE_DIR}/tests/unit)

# The tests of the cross build in `images`. `reference` is the folder of the same cases built for the
# host, or empty: then images only run and check themselves.
function(embedded_tests images reference fixture)
  set(run ${Python3_EXECUTABLE} ${CMAKE_CURRENT_SOURCE_DIR}/checks/run_image.py)
  foreach(target ${EMBEDDED_TARGETS})
    set(machine ${EMBEDDED_MACHINE_${target}})
    foreach(case ${EMBEDDED_CASES})
      set(like "")
      if(reference)
        set(like --like ${reference}/embedded_${case})
      endif()
      embedded_test(${target}/${case} "${fixture}"
                    ${run} ${machine} ${images}/${case}_${target} ${like})
    endforeach()
    embedded_test(${target}/library_needs_no_system "${fixture}"
                  ${Python3_EXECUTABLE} ${CMAKE_CURRENT_SOURCE_DIR}/checks/symbols.py
                  ${images}/libdse_${target}.a)
  endforeach()
endfunction()

function(embedded_test name fixture)
  add_test(NAME embedded/${name} COMMAND ${ARGN})
  set_tests_properties(embedded/${name} PROPERTIES LABELS embedded TIMEOUT 180
                       FIXTURES_REQUIRED "${fixture}" SKIP_RETURN_CODE 77)
endfunction()
