# The cross build: one library per target, and its images. `dse` itself knows no processor and is not
# built; it only lends its sources and options.
set_target_properties(dse PROPERTIES EXCLUDE_FROM_ALL ON)

set(script ${CMAKE_CURRENT_SOURCE_DIR}/target/memory.ld)

function(embedded_image name target)
  add_executable(${name}_${target} ${ARGN} ${EMBEDDED_SHARED})
  add_dependencies(${name}_${target} embedded_golden)
  target_include_directories(${name}_${target} PRIVATE ${EMBEDDED_INCLUDES})
  target_link_libraries(${name}_${target} PRIVATE board_${target} dse_${target} dse_warnings)
endfunction()

foreach(target ${EMBEDDED_TARGETS})
  set(processor ${EMBEDDED_PROCESSOR_${target}})
  embedded_library(dse_${target} ${EMBEDDED_REAL_${target}})
  # -fcallgraph-info: what calls what and the stack of each function, for checks/stack.py.
  target_compile_options(dse_${target} PUBLIC ${processor} PRIVATE -fcallgraph-info=su)

  add_library(board_${target} OBJECT target/startup.c target/semihosting.c)
  target_include_directories(board_${target} PRIVATE cases PUBLIC target)
  target_compile_options(board_${target} PUBLIC ${processor})
  target_link_libraries(board_${target} PRIVATE dse_warnings)
  # No start files and no system library: with a call of malloc or printf an image would not link,
  # because nobody defines _sbrk and _write.
  target_link_options(board_${target} PUBLIC ${processor} -mthumb --specs=nano.specs
                      -nostartfiles -T ${script} -Wl,--fatal-warnings)
  set_target_properties(board_${target} PROPERTIES INTERFACE_LINK_DEPENDS ${script})

  foreach(case ${EMBEDDED_CASES})
    embedded_image(${case} ${target} cases/${case}.c ${EMBEDDED_WITH_${case}})
    target_link_options(${case}_${target} PRIVATE -Wl,--gc-sections)
  endforeach()

  # All of the library in one image, whether called or not.
  embedded_image(stack ${target} target/stack.c target/stack_meter.c)
  target_compile_options(stack_${target} PRIVATE -fcallgraph-info=su)
  target_link_options(stack_${target} PRIVATE
    -Wl,--whole-archive $<TARGET_FILE:dse_${target}> -Wl,--no-whole-archive)
endforeach()

embedded_tests(${CMAKE_CURRENT_BINARY_DIR} "" "")
foreach(target ${EMBEDDED_TARGETS})
  add_dependencies(embedded-size stack_${target})
endforeach()
