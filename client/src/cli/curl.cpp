#include "cli/curl.hpp"

#include "stipple/error.hpp"

#include <dlfcn.h>

#include <string>

namespace stipple::cli {
namespace {

#if defined(__APPLE__)
constexpr const char* kLibrary = "libcurl.4.dylib";
#else
constexpr const char* kLibrary = "libcurl.so.4";
#endif

[[noreturn]] void fail() {
    throw Error(ErrorCode::Internal,
                std::string("a bucket needs libcurl (on Debian: apt-get install libcurl4): ") +
                    ::dlerror());
}

/// @param library  as dlopen gave it.
template <typename Function>
void load(void* library, const char* name, Function*& function) {
    void* const address = ::dlsym(library, name);
    if (address == nullptr) fail();
    function = reinterpret_cast<Function*>(address);
}

Curl loaded() {
    void* const library = ::dlopen(kLibrary, RTLD_LAZY | RTLD_LOCAL);
    if (library == nullptr) fail();
    Curl curl{};
    load(library, "curl_easy_init", curl.easy_init);
    load(library, "curl_easy_cleanup", curl.easy_cleanup);
    load(library, "curl_easy_setopt", curl.easy_setopt);
    load(library, "curl_easy_getinfo", curl.easy_getinfo);
    load(library, "curl_easy_perform", curl.easy_perform);
    load(library, "curl_easy_escape", curl.easy_escape);
    load(library, "curl_easy_strerror", curl.easy_strerror);
    load(library, "curl_multi_init", curl.multi_init);
    load(library, "curl_multi_cleanup", curl.multi_cleanup);
    load(library, "curl_multi_add_handle", curl.multi_add_handle);
    load(library, "curl_multi_remove_handle", curl.multi_remove_handle);
    load(library, "curl_multi_perform", curl.multi_perform);
    load(library, "curl_multi_poll", curl.multi_poll);
    load(library, "curl_multi_info_read", curl.multi_info_read);
    load(library, "curl_multi_strerror", curl.multi_strerror);
    load(library, "curl_slist_append", curl.slist_append);
    load(library, "curl_slist_free_all", curl.slist_free_all);
    load(library, "curl_free", curl.free);
    return curl;
}

}  // namespace

const Curl& curl() {
    static const Curl functions = loaded();
    return functions;
}

}  // namespace stipple::cli
