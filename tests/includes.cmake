# Reads the sources and fails on one that uses what neither it nor a header of the project that it includes asks the standard
# library for. The compiler tells only where nothing is precompiled (stipple_precompile).
cmake_minimum_required(VERSION 3.25)

# header=pattern of what is used of it. The bodies of kernels are no headers: they stand inside of a source.
set(uses
    "algorithm=std::(ranges::)?(all_of|any_of|clamp|copy|count|count_if|equal|fill|find|find_if|lower_bound|max_element|merge|min_element|minmax|none_of|nth_element|partition|partition_point|remove_if|reverse|rotate|sort|stable_sort|transform|unique|upper_bound)[(]"
    "array=std::array[^a-z_]"
    "cmath=std::(acos|atan2|cbrt|ceil|cos|exp|floor|hypot|isfinite|isnan|log|log2|lround|nextafter|pow|round|sin|sqrt)[(]"
    "cstdint=std::u?int(8|16|32|64)_t"
    "functional=std::(function|greater)[^a-z_]"
    "map=std::(multi)?map[^a-z_]"
    "memory=std::(make_shared|make_unique|shared_ptr|unique_ptr)[^a-z_]"
    "numeric=std::(accumulate|exclusive_scan|inclusive_scan|iota|midpoint|partial_sum|reduce)[^a-z_]"
    "optional=std::(optional|nullopt)[^a-z_]"
    "span=std::span[^a-z_]"
    "sstream=std::[io]?stringstream"
    "stop_token=std::stop_(callback|source|token)"
    "string=std::(string|to_string)[^a-z_]"
    "variant=std::(get_if|holds_alternative|variant|visit)[^a-z_]"
    "vector=std::vector[^a-z_]")

foreach(folder core picture proto client)
    list(APPEND roots ${folder}/include)
endforeach()
foreach(folder core picture proto server client)
    list(APPEND roots ${folder}/src)
    file(GLOB_RECURSE found RELATIVE ${SOURCE_DIR} ${SOURCE_DIR}/${folder}/*.hpp ${SOURCE_DIR}/${folder}/*.cpp)
    list(APPEND files ${found})
endforeach()
list(FILTER files EXCLUDE REGEX "_(kernels|lanes|order)_body\\.hpp$")

# What a file includes: standard_of_FILE and project_of_FILE.
foreach(file IN LISTS files)
    cmake_path(GET file PARENT_PATH here)
    file(STRINGS ${SOURCE_DIR}/${file} lines REGEX "^#include")
    foreach(line IN LISTS lines)
        if(line MATCHES "<([a-z_]+)>")
            list(APPEND standard_of_${file} ${CMAKE_MATCH_1})
        elseif(line MATCHES "\"([^\"]+)\"")
            foreach(root ${here} ${roots})
                if(EXISTS ${SOURCE_DIR}/${root}/${CMAKE_MATCH_1})
                    list(APPEND project_of_${file} ${root}/${CMAKE_MATCH_1})
                    break()
                endif()
            endforeach()
        endif()
    endforeach()
endforeach()

set(violations)
foreach(file IN LISTS files)
    set(reached ${file})
    set(asked)
    set(open ${file})
    while(open)
        list(POP_FRONT open next)
        list(APPEND asked ${standard_of_${next}})
        foreach(header IN LISTS project_of_${next})
            if(NOT header IN_LIST reached)
                list(APPEND reached ${header})
                list(APPEND open ${header})
            endif()
        endforeach()
    endwhile()

    file(READ ${SOURCE_DIR}/${file} text)
    foreach(use IN LISTS uses)
        string(REGEX MATCH "^[^=]+" header "${use}")
        string(REGEX REPLACE "^[^=]+=" "" pattern "${use}")
        if(NOT header IN_LIST asked AND text MATCHES "${pattern}")
            list(APPEND violations "${file}: ${CMAKE_MATCH_0} without <${header}>")
        endif()
    endforeach()
endforeach()

if(violations)
    list(JOIN violations "\n  " text)
    message(FATAL_ERROR "Includes that are missing:\n  ${text}")
endif()
