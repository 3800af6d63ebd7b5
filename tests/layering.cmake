# Reads the include lines and fails on one that points the wrong way:
#
#     client --> proto --> picture --> core        tests may include everything; nothing includes tests
#                  ^                     ^
#                server ------------------+

set(violations)

# forbid(folder-glob pattern why): no file below the folder includes what matches.
function(forbid glob pattern why)
    file(GLOB_RECURSE files ${SOURCE_DIR}/${glob}/*.hpp ${SOURCE_DIR}/${glob}/*.cpp)
    foreach(file IN LISTS files)
        file(STRINGS ${file} includes REGEX "^[ \t]*#[ \t]*include")
        foreach(line IN LISTS includes)
            if(line MATCHES "${pattern}")
                file(RELATIVE_PATH name ${SOURCE_DIR} ${file})
                list(APPEND violations "${name}: ${line}   (${why})")
            endif()
        endforeach()
    endforeach()
    set(violations ${violations} PARENT_SCOPE)
endfunction()

forbid(core "nlohmann|httplib|spdlog|stipple/proto/|stipple/client|sqlite3" "core knows no JSON, HTTP, logging or other folder")
forbid(core/include "nanoflann|draco/|meshoptimizer|tbb/" "libraries of core stay in core/src")
forbid(core "cairo|stipple/picture/" "core draws no text")
forbid(picture "nlohmann|httplib|spdlog|stipple/proto/|stipple/client|sqlite3" "pictures know nothing but core")
forbid(picture/include "cairo" "libraries of picture stay in picture/src")
foreach(folder proto server client)
    forbid(${folder} "cairo" "text is drawn in picture")
endforeach()
forbid(proto "httplib|spdlog|stipple/client|sqlite3" "proto knows no HTTP, logging, server or client")
forbid(proto/include "nlohmann|openssl" "libraries of proto stay in proto/src")
forbid(server "stipple/client" "the server does not know the client")
foreach(folder service store worker)
    forbid(server/src/${folder} "httplib" "HTTP stays in server/src/http")
endforeach()
foreach(folder service http worker)
    forbid(server/src/${folder} "sqlite3|libpq|curl/" "databases stay in server/src/store")
endforeach()
forbid(server/job "httplib|spdlog|sqlite3" "the job process computes and opens nothing")
forbid(client "sqlite3|\"service/|\"store/|\"worker/|\"http/" "the client does not know the server")
forbid(client/include "httplib|nlohmann|CLI/|curl/" "libraries of the client stay in client/src")
foreach(folder core picture proto server client bench)
    forbid(${folder} "tests/|support/support" "nothing includes tests")
endforeach()

if(violations)
    list(JOIN violations "\n  " text)
    message(FATAL_ERROR "include lines that point the wrong way:\n  ${text}")
endif()
