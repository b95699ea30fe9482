# Build settings that every target of Cairn shares, and the three kinds of target there are:
#   cairn_library(NAME [DEPS ...])   one static library from the *.cc of the calling folder
#   cairn_program(NAME SOURCES ... [DEPS ...])
#   cairn_tests(NAME [DEPS ...])     one GoogleTest program from the *_test.cc of the calling folder

option(CAIRN_TESTS "Build the tests and benchmarks" ON)
option(CAIRN_WERROR "Treat warnings in Cairn's own code as errors" ON)
set(CAIRN_SANITIZE "" CACHE STRING "Sanitizers to build with, as for -fsanitize=")

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)

# What users install must run on any x86-64-v2 machine; wider vectors are chosen at run time.
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  add_compile_options(-march=x86-64-v2)
endif()

find_program(CAIRN_CCACHE ccache)
if(CAIRN_CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CAIRN_CCACHE})
  set(CMAKE_C_COMPILER_LAUNCHER ${CAIRN_CCACHE})
endif()

add_library(cairn_options INTERFACE)
target_include_directories(cairn_options INTERFACE ${CMAKE_SOURCE_DIR})
target_compile_options(cairn_options INTERFACE
  $<$<COMPILE_LANGUAGE:CXX>:-Wall -Wextra -Wshadow -Wnon-virtual-dtor -Woverloaded-virtual>)
if(CAIRN_WERROR)
  target_compile_options(cairn_options INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-Werror>)
endif()
target_link_libraries(cairn_options INTERFACE Threads::Threads)

if(CAIRN_SANITIZE)
  # With the sanitizers' checks in between GCC 12 takes the standard library's own members for
  # uninitialised (std::function inside std::regex), and an index for one below zero that can't be.
  target_compile_options(cairn_options INTERFACE
    $<$<COMPILE_LANGUAGE:CXX>:-Wno-maybe-uninitialized> $<$<COMPILE_LANGUAGE:CXX>:-Wno-array-bounds>)
  add_compile_options(-fsanitize=${CAIRN_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${CAIRN_SANITIZE})
endif()

# Sanitizers cost time: how many times longer tests may take. And they are told what to leave alone,
# by each test's own environment, so that it reaches the programs that tests start too.
set(CAIRN_TEST_TIMEOUT_SCALE 1)
set(cairn_test_properties)
if(CAIRN_SANITIZE MATCHES "thread")
  set(CAIRN_TEST_TIMEOUT_SCALE 10)
  set(cairn_test_properties ENVIRONMENT
      "TSAN_OPTIONS=suppressions=${CMAKE_SOURCE_DIR}/tests/support/tsan.supp")
elseif(CAIRN_SANITIZE)
  set(CAIRN_TEST_TIMEOUT_SCALE 5)
endif()

# Registers each test of a GoogleTest program with ctest.
function(cairn_register_tests name seconds)
  math(EXPR timeout "${seconds} * ${CAIRN_TEST_TIMEOUT_SCALE}")
  gtest_discover_tests(${name} DISCOVERY_MODE PRE_TEST
                       PROPERTIES TIMEOUT ${timeout} ${cairn_test_properties} ${ARGN})
endfunction()

# Third-party headers are system headers: their warnings are not ours.
function(cairn_link target)
  target_link_libraries(${target} PUBLIC ${ARGN})
endfunction()

function(cairn_library name)
  cmake_parse_arguments(ARG "" "" "DEPS" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cc)
  list(FILTER sources EXCLUDE REGEX "/main\\.cc$")
  if(sources)
    add_library(${name} STATIC ${sources})
    target_link_libraries(${name} PUBLIC cairn_options ${ARG_DEPS})
  else()
    add_library(${name} INTERFACE)
    target_link_libraries(${name} INTERFACE cairn_options ${ARG_DEPS})
  endif()
endfunction()

function(cairn_program name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE cairn_options ${ARG_DEPS})
  target_compile_definitions(${name} PRIVATE CAIRN_VERSION="${PROJECT_VERSION}")
endfunction()

function(cairn_tests name)
  cmake_parse_arguments(ARG "" "" "DEPS" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*_test.cc)
  if(NOT sources)
    return()
  endif()
  add_executable(${name} ${sources})
  target_link_libraries(${name} PRIVATE cairn_options GTest::gmock GTest::gtest_main ${ARG_DEPS})
  cairn_register_tests(${name} 120)
endfunction()
