# The cross build. One library per processor, from the same sources and with the same options as the
# host's; `dse` itself, which knows no processor, only lends them.
set_target_properties(dse PROPERTIES EXCLUDE_FROM_ALL ON)
get_target_property(sources dse SOURCES)
get_target_property(includes dse INTERFACE_INCLUDE_DIRECTORIES)
get_target_property(definitions dse INTERFACE_COMPILE_DEFINITIONS)
get_target_property(options dse COMPILE_OPTIONS)

# The M4F computes in single precision; doubles are done by the compiler's runtime.
set(processor_m4f -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard)
set(processor_m7 -mcpu=cortex-m7 -mfpu=fpv5-d16 -mfloat-abi=hard)

set(script ${CMAKE_CURRENT_SOURCE_DIR}/target/memory.ld)

function(embedded_image name target)
  add_executable(${name}_${target} ${ARGN} ${EMBEDDED_SHARED})
  add_dependencies(${name}_${target} embedded_golden)
  target_include_directories(${name}_${target} PRIVATE ${EMBEDDED_INCLUDES})
  target_link_libraries(${name}_${target} PRIVATE board_${target} dse_${target} dse_warnings)
endfunction()

foreach(target ${EMBEDDED_TARGETS})
  add_library(dse_${target} STATIC ${sources})
  target_include_directories(dse_${target} PUBLIC ${includes})
  target_compile_definitions(dse_${target} PUBLIC ${definitions})
  # -fcallgraph-info: what calls what and the stack of each function, for checks/stack.py.
  target_compile_options(dse_${target} PUBLIC ${processor_${target}}
                         PRIVATE ${options} -fcallgraph-info=su)
  target_link_libraries(dse_${target} PRIVATE dse_warnings)

  add_library(board_${target} OBJECT target/startup.c target/semihosting.c)
  target_include_directories(board_${target} PRIVATE cases PUBLIC target)
  target_compile_options(board_${target} PUBLIC ${processor_${target}})
  target_link_libraries(board_${target} PRIVATE dse_warnings)
  # No start files and no system library: with a call of malloc or printf an image would not link,
  # because nobody defines _sbrk and _write.
  target_link_options(board_${target} PUBLIC ${processor_${target}} -mthumb --specs=nano.specs
                      -nostartfiles -T ${script} -Wl,--fatal-warnings)
  set_target_properties(board_${target} PROPERTIES INTERFACE_LINK_DEPENDS ${script})

  foreach(case ${EMBEDDED_CASES})
    embedded_image(${case} ${target} cases/${case}.c)
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
