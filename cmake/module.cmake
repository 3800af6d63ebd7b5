# stipple_add_module(NAME FOLDERS folders... PUBLIC targets... PRIVATE targets... PRECOMPILE headers...): a folder's whole list file. It takes
# the sources from src/ and its FOLDERS, the public headers from include/, and adds the alias stipple::NAME, the warnings, the install rule and
# a check that each public header compiles alone.

add_library(stipple_build_flags INTERFACE)
target_compile_features(stipple_build_flags INTERFACE cxx_std_20)
# Contraction to fused multiply-add would make results depend on the instruction set.
target_compile_options(stipple_build_flags INTERFACE -ffp-contract=off)
if(STIPPLE_NATIVE)
    target_compile_options(stipple_build_flags INTERFACE -march=native)
elseif(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    target_compile_options(stipple_build_flags INTERFACE -march=x86-64-v2)
endif()
if(STIPPLE_SANITIZE)
    # The checks of single accesses that are left out double the time to compile; the address sanitizer sees what they find.
    # What is found ends the program: the undefined-behaviour sanitizer alone would only print it, and the test pass.
    target_compile_options(stipple_build_flags INTERFACE -fsanitize=${STIPPLE_SANITIZE} -fno-omit-frame-pointer
                           -fno-sanitize=null,alignment,object-size,vptr,pointer-overflow -fno-sanitize-recover=all)
    target_link_options(stipple_build_flags INTERFACE -fsanitize=${STIPPLE_SANITIZE})
endif()

# gcc 12 takes sums of strings for overlapping copies (its bug 105651).
set(false_restrict "$<AND:$<CXX_COMPILER_ID:GNU>,$<VERSION_LESS:$<CXX_COMPILER_VERSION>,13>>")
add_library(stipple_warnings INTERFACE)
target_compile_options(stipple_warnings INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor
                       -Woverloaded-virtual $<${false_restrict}:-Wno-restrict> $<$<BOOL:${STIPPLE_WERROR}>:-Werror>)

# stipple_precompile(TARGET headers... | REUSE_FROM target): where it is asked for, these and the standard headers that
# nearly every source has: half of a compilation goes into reading them. Only headers of the system, so that no edit here
# builds all anew. Not with ccache, which finds nothing again that was compiled with a precompiled header.
function(stipple_precompile target)
    if(NOT STIPPLE_PRECOMPILE OR CMAKE_CXX_COMPILER_LAUNCHER MATCHES "ccache")
        return()
    endif()
    # Of the standard library's own strings, once they come precompiled: gcc's bug 105651.
    target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-Wno-array-bounds -Wno-restrict>)
    if(ARGV1 STREQUAL "REUSE_FROM")
        target_precompile_headers(${target} ${ARGN})
    else()
        target_precompile_headers(${target} PRIVATE ${ARGN}
            <Eigen/Core> <algorithm> <array> <cmath> <cstdint> <functional> <map> <memory> <numeric> <optional> <span>
            <sstream> <stop_token> <string> <string_view> <utility> <variant> <vector>)
    endif()
endfunction()

function(stipple_add_module name)
    cmake_parse_arguments(arg "" "" "FOLDERS;PUBLIC;PRIVATE;PRECOMPILE" ${ARGN})
    file(GLOB_RECURSE headers CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/include/*.hpp)
    list(TRANSFORM arg_FOLDERS REPLACE ".+" "${CMAKE_CURRENT_SOURCE_DIR}/src/\\0/*.cpp" OUTPUT_VARIABLE in_folders)
    file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/src/*.cpp ${in_folders})
    list(FILTER sources EXCLUDE REGEX "/main\\.cpp$")

    add_library(stipple_${name} STATIC ${sources})
    add_library(stipple::${name} ALIAS stipple_${name})
    set_target_properties(stipple_${name} PROPERTIES EXPORT_NAME ${name} POSITION_INDEPENDENT_CODE ON)
    target_sources(stipple_${name} PUBLIC FILE_SET HEADERS BASE_DIRS include FILES ${headers})
    target_include_directories(stipple_${name} PRIVATE src)
    target_link_libraries(stipple_${name}
        PUBLIC ${arg_PUBLIC} Threads::Threads
        PRIVATE ${arg_PRIVATE} $<BUILD_INTERFACE:stipple_build_flags> $<BUILD_INTERFACE:stipple_warnings>)
    target_compile_features(stipple_${name} PUBLIC cxx_std_20)
    if(arg_PRECOMPILE)
        stipple_precompile(stipple_${name} ${arg_PRECOMPILE})
    endif()

    # Every public header compiles alone: the source of its name includes it first, else one made here does.
    set(checks)
    foreach(header IN LISTS headers)
        cmake_path(RELATIVE_PATH header BASE_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR}/include OUTPUT_VARIABLE relative)
        cmake_path(GET relative STEM stem)
        set(source ${sources})
        list(FILTER source INCLUDE REGEX "/${stem}\\.cpp$")
        if(source)
            file(STRINGS ${source} first_include REGEX "^#include" LIMIT_COUNT 1)
            if(first_include STREQUAL "#include \"${relative}\"")
                continue()
            endif()
        endif()
        string(MAKE_C_IDENTIFIER ${relative} id)
        file(CONFIGURE OUTPUT header_check/${id}.cpp CONTENT "#include \"${relative}\" // IWYU pragma: keep\n")
        list(APPEND checks ${CMAKE_CURRENT_BINARY_DIR}/header_check/${id}.cpp)
    endforeach()
    if(checks AND STIPPLE_BUILD_TESTS)
        add_library(stipple_${name}_header_check OBJECT ${checks})
        target_link_libraries(stipple_${name}_header_check PRIVATE stipple_${name} stipple_build_flags stipple_warnings)
    endif()

    install(TARGETS stipple_${name} EXPORT stipple-targets FILE_SET HEADERS)
endfunction()

# stipple_add_program(NAME sources... LINK targets...): an executable with the project's flags.
function(stipple_add_program name)
    cmake_parse_arguments(arg "" "" "LINK" ${ARGN})
    add_executable(${name} ${arg_UNPARSED_ARGUMENTS})
    target_link_libraries(${name} PRIVATE ${arg_LINK} stipple_build_flags stipple_warnings)
endfunction()
