# gantry_module(<name> [DEPENDS modules] [FOREIGN includes] [LINK libraries] [GENERATED sources]
#               [TEST_DEPENDS modules] [TEST_FOREIGN includes] [TEST_LINK libraries] [TEST_LABELS labels])
#   One folder under src/ = one static library gantry_<name>; tests/*_test.cpp = one test program; tests/*_fuzz.cpp = fuzzers.
#   DEPENDS names the modules it may include; FOREIGN the outside header prefixes (and `clock`); tools/check_layers.py
#   holds every file to both. The TEST_ words add to them for the tests alone.
#   Labels: `threads` is run under ThreadSanitizer too, `long` only by `./dev test --full`.
function(gantry_module name)
  cmake_parse_arguments(M "" "" "DEPENDS;FOREIGN;LINK;GENERATED;TEST_DEPENDS;TEST_FOREIGN;TEST_LINK;TEST_LABELS" ${ARGN})
  if(M_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "gantry_module(${name}): what is ${M_UNPARSED_ARGUMENTS}?")
  endif()
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  list(FILTER sources EXCLUDE REGEX "/main\\.cpp$")
  list(APPEND sources ${M_GENERATED})
  string(REPLACE "/" "_" target gantry_${name})
  if(sources)
    add_library(${target} STATIC ${sources})
    gantry_batches(${target})
    set(scope PUBLIC)
  else()
    add_library(${target} INTERFACE)
    set(scope INTERFACE)
  endif()
  target_include_directories(${target} ${scope} ${PROJECT_SOURCE_DIR}/src)
  list(TRANSFORM M_DEPENDS REPLACE "/" "_")
  list(TRANSFORM M_DEPENDS PREPEND gantry_)
  target_link_libraries(${target} ${scope} gantry_options ${M_DEPENDS} ${M_LINK})

  file(GLOB tests CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/tests/*_test.cpp)
  if(tests AND BUILD_TESTING)
    list(TRANSFORM M_TEST_DEPENDS REPLACE "/" "_")
    list(TRANSFORM M_TEST_DEPENDS PREPEND gantry_)
    gantry_test(${target}_test ${tests} LINK ${target} ${M_TEST_DEPENDS} ${M_TEST_LINK} LABELS ${M_TEST_LABELS})
  endif()
  file(GLOB fuzzers CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/tests/*_fuzz.cpp)
  foreach(file IN LISTS fuzzers)
    if(GANTRY_FUZZ)
      cmake_path(GET file STEM stem)
      add_executable(${stem} ${file})
      target_link_libraries(${stem} PRIVATE ${target} -fsanitize=fuzzer)
      set_property(GLOBAL APPEND PROPERTY GANTRY_FUZZERS ${stem})
    endif()
  endforeach()
endfunction()

# gantry_test(<target> <sources>... LINK <libraries>... [TIMEOUT seconds] [LABELS labels]): a test program whose
# tests ctest lists one by one.
function(gantry_test target)
  cmake_parse_arguments(T "" "TIMEOUT" "LINK;LABELS" ${ARGN})
  if(NOT T_TIMEOUT)
    set(T_TIMEOUT 120)
  endif()
  if(CMAKE_CXX_FLAGS MATCHES "-fsanitize=")
    math(EXPR T_TIMEOUT "3 * ${T_TIMEOUT}")
  endif()
  add_executable(${target} ${T_UNPARSED_ARGUMENTS})
  gantry_batches(${target})
  target_link_libraries(${target} PRIVATE gantry_testkit ${T_LINK} GTest::gtest_main)
  target_compile_definitions(${target} PRIVATE GANTRY_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  if(CMAKE_CXX_FLAGS MATCHES "-fsanitize=")  # sanitizers are for what is tested; optimised, the tests take far longer to build
    target_compile_options(${target} PRIVATE -O0)
  endif()
  gtest_discover_tests(${target} DISCOVERY_MODE PRE_TEST PROPERTIES TIMEOUT ${T_TIMEOUT} LABELS "${T_LABELS}")
  if("threads" IN_LIST T_LABELS)
    set_property(GLOBAL APPEND PROPERTY GANTRY_THREAD_TESTS ${target})
  endif()
endfunction()

# gantry_batches(<target>): where GANTRY_BATCHES is ON the target's files are compiled several at once, as batches that
# tools/unity.py finds; headers, most of what a file costs, are then read once a batch. Those of the dev preset are
# small, so that a change is compiled in seconds; the single preset compiles every file by itself: there an include that
# a file forgot is an error.
function(gantry_batches target)
  if(NOT GANTRY_BATCHES)
    return()
  endif()
  get_target_property(sources ${target} SOURCES)
  execute_process(COMMAND ${Python3_EXECUTABLE} -B ${PROJECT_SOURCE_DIR}/tools/unity.py ${GANTRY_BATCH_BYTES} ${sources}
    WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR} OUTPUT_VARIABLE batches OUTPUT_STRIP_TRAILING_WHITESPACE
    COMMAND_ERROR_IS_FATAL ANY)
  string(REPLACE "\n" ";" batches "${batches}")
  set(number 0)
  foreach(batch IN LISTS batches)
    math(EXPR number "${number} + 1")
    string(REPLACE "\t" ";" files "${batch}")
    set_source_files_properties(${files} PROPERTIES UNITY_GROUP ${number})
  endforeach()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
endfunction()

# gantry_groups(): the targets that build all of a kind, for ./dev. Last, when every folder has said what it has.
function(gantry_groups)
  get_property(fuzzers GLOBAL PROPERTY GANTRY_FUZZERS)
  get_property(thread_tests GLOBAL PROPERTY GANTRY_THREAD_TESTS)
  add_custom_target(gantry_fuzzers)
  add_custom_target(gantry_thread_tests)
  if(fuzzers)
    add_dependencies(gantry_fuzzers ${fuzzers})
  endif()
  if(thread_tests)
    add_dependencies(gantry_thread_tests ${thread_tests})
  endif()
endfunction()

# gantry_protocol(<make>): the one line that adds a make's folder to the build and to the registry.
function(gantry_protocol make)
  add_subdirectory(${make})
  set_property(GLOBAL APPEND PROPERTY GANTRY_PROTOCOLS ${make})
endfunction()

# gantry_sink(<kind>): the one line that adds a destination's folder to the build and to the registry.
function(gantry_sink kind)
  add_subdirectory(${kind})
  set_property(GLOBAL APPEND PROPERTY GANTRY_SINKS ${kind})
endfunction()
