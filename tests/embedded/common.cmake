# What both sides need to know: the cases, the boards, the tests.
find_package(Python3 REQUIRED COMPONENTS Interpreter)

# cases/<case>.c runs on the host and on every target.
set(EMBEDDED_CASES math linalg ekf high_gain_ekf distributed_observer coordinated_mhe consensus
    example)

# What a case has beside its own source: EMBEDDED_WITH_<case>.
set(EMBEDDED_WITH_distributed_observer ../unit/observer_rig.c ../unit/observer_designs.c)

# The M4F computes in single precision; its doubles are done by the compiler's runtime. Hence the
# library is tried there in both precisions.
set(EMBEDDED_TARGETS m4f m4f_float m7)
set(m4f -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard)
set(m7 -mcpu=cortex-m7 -mfpu=fpv5-d16 -mfloat-abi=hard)
set(EMBEDDED_PROCESSOR_m4f ${m4f})
set(EMBEDDED_PROCESSOR_m4f_float ${m4f})
set(EMBEDDED_PROCESSOR_m7 ${m7})
set(EMBEDDED_MACHINE_m4f mps2-an386)
set(EMBEDDED_MACHINE_m4f_float mps2-an386)
set(EMBEDDED_MACHINE_m7 mps2-an500)
set(EMBEDDED_REAL_m4f double)
set(EMBEDDED_REAL_m4f_float float)
set(EMBEDDED_REAL_m7 double)

# Expected values become C tables: an image has no files to read.
set(generated ${CMAKE_CURRENT_BINARY_DIR}/golden)
set(here ${CMAKE_CURRENT_SOURCE_DIR})
set(run ${CMAKE_SOURCE_DIR}/tests/golden/adaptive_high_gain_ekf/run_ch2_cont_ahg.json)
file(MAKE_DIRECTORY ${generated})
add_custom_command(OUTPUT ${generated}/golden_high_gain.h
  COMMAND ${Python3_EXECUTABLE} ${here}/golden/high_gain_table.py ${run} 120
          ${generated}/golden_high_gain.h
  DEPENDS ${run} golden/high_gain_table.py VERBATIM)
add_custom_command(OUTPUT ${generated}/golden_ekf.h
  COMMAND ${Python3_EXECUTABLE} ${here}/golden/ekf_table.py ${generated}/golden_ekf.h
  DEPENDS golden/ekf_table.py VERBATIM)
add_custom_target(embedded_golden DEPENDS ${generated}/golden_high_gain.h ${generated}/golden_ekf.h)

# Sources that several cases share, and the program of README.md.
set(EMBEDDED_SHARED cases/report.c cases/cstr2_network.c example_microcontroller.c)
set_source_files_properties(example_microcontroller.c PROPERTIES
  COMPILE_OPTIONS "-Wno-unused-parameter;-Wno-float-conversion")
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
        set(like --like ${reference}/embedded_${case}_${EMBEDDED_REAL_${target}})
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

# libdse once more, from the same sources and with the same options, in the given precision.
function(embedded_library name real)
  get_target_property(sources dse SOURCES)
  get_target_property(includes dse INTERFACE_INCLUDE_DIRECTORIES)
  get_target_property(options dse COMPILE_OPTIONS)
  add_library(${name} STATIC ${sources})
  target_include_directories(${name} PUBLIC ${includes})
  target_compile_definitions(${name} PUBLIC DSE_REAL_IS_${real}=1)
  target_compile_options(${name} PRIVATE ${options})
  target_link_libraries(${name} PRIVATE dse_warnings)
endfunction()

function(embedded_test name fixture)
  add_test(NAME embedded/${name} COMMAND ${ARGN})
  set_tests_properties(embedded/${name} PROPERTIES LABELS embedded TIMEOUT 180
                       FIXTURES_REQUIRED "${fixture}" SKIP_RETURN_CODE 77)
endfunction()
