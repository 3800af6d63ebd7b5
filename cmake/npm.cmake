# The packages of package-lock.json, for what is built or tested with node.
include_guard(GLOBAL)

find_program(STIPPLE_NPM npm)
find_program(STIPPLE_NODE NAMES node nodejs)

# stipple_npm_packages(stamp): brings the packages of the current folder's package-lock.json into node_modules of its build folder,
# without running any of their scripts; `stamp` becomes the file to depend on.
function(stipple_npm_packages stamp)
    set(folder ${CMAKE_CURRENT_BINARY_DIR})
    set(installed ${folder}/node_modules/.package-lock.json)
    file(RELATIVE_PATH name ${PROJECT_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR})
    add_custom_command(
        OUTPUT ${installed}
        COMMAND ${CMAKE_COMMAND} -E copy_if_different ${CMAKE_CURRENT_SOURCE_DIR}/package.json
                ${CMAKE_CURRENT_SOURCE_DIR}/package-lock.json ${folder}
        COMMAND ${STIPPLE_NPM} ci --ignore-scripts --no-audit --no-fund --loglevel=error
        COMMAND ${CMAKE_COMMAND} -E touch ${installed}
        DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/package.json ${CMAKE_CURRENT_SOURCE_DIR}/package-lock.json
        WORKING_DIRECTORY ${folder}
        COMMENT "${name}: npm ci" VERBATIM)
    set(${stamp} ${installed} PARENT_SCOPE)
endfunction()

# stipple_add_node_test(name script NEEDS targets... ARGS arguments...): a test in node, with the packages of the current folder, that
# runs the programs `targets`. Skipped, and saying so, where node or npm is missing.
function(stipple_add_node_test name script)
    cmake_parse_arguments(arg "" "" "NEEDS;ARGS" ${ARGN})
    if(NOT (STIPPLE_NODE AND STIPPLE_NPM))
        add_test(NAME ${name} COMMAND sh -c "echo 'SKIPPED: node and npm are needed'; exit 77")
    else()
        get_filename_component(target ${CMAKE_CURRENT_SOURCE_DIR} NAME)
        set(target e2e_${target}_packages)
        if(NOT TARGET ${target})  # by another test of the folder
            stipple_npm_packages(installed)
            add_custom_target(${target} ALL DEPENDS ${installed})
        endif()
        add_dependencies(${target} ${arg_NEEDS})
        add_test(NAME ${name}
            COMMAND ${STIPPLE_NODE} ${CMAKE_CURRENT_SOURCE_DIR}/${script} --bin ${CMAKE_RUNTIME_OUTPUT_DIRECTORY}
                    --modules ${CMAKE_CURRENT_BINARY_DIR}/node_modules ${arg_ARGS})
    endif()
    # Begun first: the longest of all would else run alone at the end.
    set_tests_properties(${name} PROPERTIES LABELS e2e SKIP_RETURN_CODE 77 TIMEOUT 900 COST 100)
endfunction()
