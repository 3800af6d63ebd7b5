// Runs during the build: turns openapi.yaml into a page for reading, and both into a source of the
// server.
//
//     make_openapi_files openapi.yaml docs.css openapi_files.cpp

#include "stipple/proto/digest.hpp"

#include <yaml-cpp/yaml.h>
#include <array>
#include <fstream>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

namespace {

std::string read_file(const char* name) {
    std::ifstream in(name, std::ios::binary);
    if (!in) throw std::runtime_error(std::string("cannot read ") + name);
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
}

std::string escaped(std::string_view text) {
    std::string out;
    for (const char c : text) {
        if (c == '&')
            out += "&amp;";
        else if (c == '<')
            out += "&lt;";
        else if (c == '>')
            out += "&gt;";
        else if (c == '"')
            out += "&quot;";
        else
            out += c;
    }
    return out;
}

/// Escaped, with `code` between backquotes.
std::string inline_text(std::string_view text) {
    std::string out;
    bool code = false;
    for (const char c : text) {
        if (c == '`') {
            out += code ? "</code>" : "<code>";
            code = !code;
        } else {
            out += escaped(std::string_view(&c, 1));
        }
    }
    return out;
}

/// The little of Markdown that our descriptions use: paragraphs, and lists of lines that begin with
/// a dash.
std::string block_text(const std::string& text) {
    std::istringstream lines(text);
    std::string out;
    std::string open;  // the element under way
    const auto enter = [&](const std::string& element) {
        if (open == element) return false;
        if (!open.empty()) out += "</" + open + ">\n";
        open = element;
        if (!open.empty()) out += "<" + open + ">";
        return true;
    };
    for (std::string line; std::getline(lines, line);) {
        if (line.empty()) {
            if (open == "p") enter("");
        } else if (line.starts_with("- ")) {
            enter("ul");
            out += "<li>" + inline_text(line.substr(2));
        } else {
            if (open != "ul" && !enter("p")) out += ' ';
            out += (open == "ul" ? " " : "") + inline_text(line);
        }
    }
    enter("");
    return out;
}

std::string text_of(const YAML::Node& node, const char* key) {
    return node[key] ? node[key].as<std::string>() : std::string();
}

class Page {
public:
    explicit Page(const YAML::Node& document) : document_(document) {}

    std::string html() {
        const YAML::Node info = document_["info"];
        out_ << "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
             << "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>"
             << escaped(text_of(info, "title"))
             << " API</title>\n<link rel=\"stylesheet\" href=\"docs.css\">\n"
             << "</head>\n<body>\n<div class=\"layout\">\n";
        out_ << "<header>\n<h1>" << escaped(text_of(info, "title")) << " <small>"
             << escaped(text_of(info, "version")) << "</small></h1>\n<p class=\"summary\">"
             << inline_text(text_of(info, "summary")) << "</p>\n"
             << block_text(text_of(info, "description"))
             << "<p>As <a href=\"openapi.yaml\">OpenAPI 3.1</a>. <a href=\"./\">The "
                "viewer</a>.</p>\n</header>\n";
        contents();
        out_ << "<main>\n";
        for (const auto& tag : document_["tags"]) operations_of(tag);
        schemas();
        out_ << "</main>\n</div>\n</body>\n</html>\n";
        return out_.str();
    }

private:
    template <typename Visit>
    void each_operation(const std::string& tag, Visit visit) {
        for (const auto& path : document_["paths"]) {
            for (const auto& operation : path.second) {
                if (operation.second["tags"][0].as<std::string>() == tag) {
                    visit(operation.first.as<std::string>(), path.first.as<std::string>(),
                          operation.second);
                }
            }
        }
    }

    void contents() {
        out_ << "<nav>\n";
        for (const auto& tag : document_["tags"]) {
            const std::string name = text_of(tag, "name");
            out_ << "<h2>" << escaped(name) << "</h2>\n<ul>\n";
            each_operation(
                name, [this](const std::string&, const std::string&, const YAML::Node& operation) {
                    out_ << "<li><a href=\"#" << text_of(operation, "operationId") << "\">"
                         << inline_text(text_of(operation, "summary")) << "</a></li>\n";
                });
            out_ << "</ul>\n";
        }
        out_ << "<h2>schemas</h2>\n<ul>\n";
        for (const auto& schema : document_["components"]["schemas"]) {
            if (!schema.second["properties"]) continue;
            const std::string name = schema.first.as<std::string>();
            out_ << "<li><a href=\"#" << name << "\">" << name << "</a></li>\n";
        }
        out_ << "</ul>\n</nav>\n";
    }

    void operations_of(const YAML::Node& tag) {
        out_ << "<h2>" << escaped(text_of(tag, "name")) << "</h2>\n"
             << block_text(text_of(tag, "description"));
        each_operation(
            text_of(tag, "name"),
            [this](const std::string& method, const std::string& path,
                   const YAML::Node& operation) { this->operation(method, path, operation); });
    }

    void operation(const std::string& method, const std::string& path, const YAML::Node& node) {
        std::string upper = method;
        for (char& c : upper) c = static_cast<char>(c - ('a' - 'A'));
        out_ << "<section>\n";
        if (node["x-scope"])
            out_ << "<span class=\"scope\">scope " << text_of(node, "x-scope") << "</span>\n";
        out_ << "<h3 id=\"" << text_of(node, "operationId") << "\">"
             << inline_text(text_of(node, "summary"))
             << "</h3>\n<div class=\"path\"><span class=\"method " << method << "\">" << upper
             << "</span>" << escaped(path) << "</div>\n"
             << block_text(text_of(node, "description"));
        if (node["requestBody"]) content("Body", node["requestBody"]["content"]);
        if (node["parameters"]) parameters(node["parameters"]);
        responses(node["responses"]);
        out_ << "</section>\n";
    }

    void content(const char* title, const YAML::Node& types) {
        out_ << "<h4>" << title << "</h4>\n<table>\n";
        for (const auto& type : types) {
            row(escaped(type.first.as<std::string>()), type_of(type.second["schema"]), "");
        }
        out_ << "</table>\n";
    }

    void parameters(const YAML::Node& list) {
        out_ << "<h4>Parameters</h4>\n<table>\n";
        for (const auto& entry : list) {
            const YAML::Node parameter = resolved(entry);
            row(escaped(text_of(parameter, "name")),
                escaped(text_of(parameter, "in")) + ", " + type_of(parameter["schema"]),
                inline_text(text_of(parameter, "description")));
        }
        out_ << "</table>\n";
    }

    void responses(const YAML::Node& map) {
        out_ << "<h4>Replies</h4>\n<table>\n";
        for (const auto& entry : map) {
            const YAML::Node response = resolved(entry.second);
            std::string types;
            for (const auto& type : response["content"]) {
                const YAML::Node schema = type.second["schema"];
                types += (types.empty() ? "" : "<br>") +
                         (schema && schema["$ref"] ? type_of(schema)
                                                   : escaped(type.first.as<std::string>()));
            }
            std::string description = inline_text(text_of(response, "description"));
            for (const auto& header : response["headers"]) {
                description += " <code>" + escaped(header.first.as<std::string>()) + "</code>";
            }
            row(escaped(entry.first.as<std::string>()), types, description);
        }
        out_ << "</table>\n";
    }

    void schemas() {
        out_ << "<h2>schemas</h2>\n";
        for (const auto& entry : document_["components"]["schemas"]) {
            const YAML::Node schema = entry.second;
            const std::string name = entry.first.as<std::string>();
            out_ << "<section>\n<h3 id=\"" << name << "\">" << name << "</h3>\n"
                 << block_text(text_of(schema, "description"));
            if (!schema["properties"]) out_ << "<p>" << type_of(schema) << "</p>\n";
            if (schema["properties"]) properties(schema);
            out_ << "</section>\n";
        }
    }

    void properties(const YAML::Node& schema) {
        out_ << "<table>\n";
        for (const auto& entry : schema["properties"]) {
            const std::string name = entry.first.as<std::string>();
            row(escaped(name),
                type_of(entry.second) + (requires_field(schema, name) ? "" : ", optional"),
                inline_text(text_of(entry.second, "description")));
        }
        out_ << "</table>\n";
    }

    static bool requires_field(const YAML::Node& schema, const std::string& name) {
        for (const auto& field : schema["required"])
            if (field.as<std::string>() == name) return true;
        return false;
    }

    void row(const std::string& name, const std::string& type, const std::string& description) {
        out_ << "<tr><td>" << name << "</td><td>" << type << "</td><td>" << description
             << "</td></tr>\n";
    }

    /// What a schema allows, in a few words.
    std::string type_of(const YAML::Node& schema) {
        if (!schema || schema.IsNull()) return "bytes";
        if (schema["$ref"]) {
            const auto reference = schema["$ref"].as<std::string>();
            if (reference.find("/properties/") != reference.npos) return type_of(resolved(schema));
            const std::string name = last_part(reference);
            return "<a href=\"#" + name + "\">" + name + "</a>";
        }
        if (schema["enum"])
            return list_of(schema["enum"], " | ", [](const YAML::Node& n) {
                return "<code>" + escaped(n.as<std::string>()) + "</code>";
            });
        if (schema["const"]) return "<code>" + escaped(text_of(schema, "const")) + "</code>";
        for (const char* combined : {"oneOf", "allOf"}) {
            if (schema[combined])
                return list_of(schema[combined], combined[0] == 'o' ? " or " : " and ",
                               [this](const YAML::Node& n) { return type_of(n); });
        }
        if (schema["items"]) return "list of " + type_of(schema["items"]);
        return escaped(text_of(schema, "type")) + range_of(schema);
    }

    static std::string range_of(const YAML::Node& schema) {
        std::string range;
        if (schema["minimum"]) range += " ≥ " + text_of(schema, "minimum");
        if (schema["exclusiveMinimum"]) range += " &gt; " + text_of(schema, "exclusiveMinimum");
        if (schema["maximum"]) range += " ≤ " + text_of(schema, "maximum");
        if (schema["pattern"]) range += " <code>" + escaped(text_of(schema, "pattern")) + "</code>";
        if (schema["default"] && schema["default"].IsScalar())
            range += " = " + escaped(text_of(schema, "default"));
        return range;
    }

    template <typename Show>
    static std::string list_of(const YAML::Node& list, const char* separator, Show show) {
        std::string out;
        for (const auto& item : list) out += (out.empty() ? "" : separator) + show(item);
        return out;
    }

    static std::string last_part(const std::string& reference) {
        return reference.substr(reference.rfind('/') + 1);
    }

    YAML::Node resolved(const YAML::Node& node) const {
        if (!node["$ref"]) return node;
        std::istringstream parts(node["$ref"].as<std::string>().substr(2));
        YAML::Node found = document_;
        for (std::string part; std::getline(parts, part, '/');) found.reset(found[part]);
        return found;
    }

    const YAML::Node document_;
    std::ostringstream out_;
};

/// A function of the generated source that returns this text.
void write_function(std::ostream& out, const char* name, const std::string& text,
                    const char* media_type) {
    const std::string etag = stipple::proto::sha256_hex(std::as_bytes(std::span(text)));
    out << "File " << name << "() {\n    return {R\"~~~~(" << text << ")~~~~\", \"" << media_type
        << "\", \"" << etag << "\"};\n}\n\n";
}

void make(const char* document_file, const char* style_file, const char* out_file) {
    const std::string document = read_file(document_file);
    std::ofstream out(out_file, std::ios::binary);
    out << "// Made by make_openapi_files from openapi.yaml.\n#include \"openapi_files.hpp\"\n\n"
        << "namespace stipple::server::openapi {\n\n";
    write_function(out, "document", document, "application/yaml");
    write_function(out, "page", Page(YAML::Load(document)).html(), "text/html; charset=utf-8");
    write_function(out, "style", read_file(style_file), "text/css; charset=utf-8");
    out << "}  // namespace stipple::server::openapi\n";
    if (!out.flush()) throw std::runtime_error(std::string("cannot write ") + out_file);
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 4) {
        std::cerr << "usage: make_openapi_files openapi.yaml docs.css openapi_files.cpp\n";
        return 2;
    }
    try {
        make(argv[1], argv[2], argv[3]);
    } catch (const std::exception& error) {
        std::cerr << "make_openapi_files: " << error.what() << '\n';
        return 1;
    }
}
