#include "graph/spec.h"

#include <algorithm>
#include <charconv>

namespace knead {

GraphSpec& GraphSpec::add(std::string name, std::string type, Literal::Map arguments) {
  nodes.push_back({std::move(name), std::move(type), std::move(arguments), 0, 0});
  return *this;
}

namespace {

// Reads maps with known keys and collects what is wrong with them.
class SpecReader {
 public:
  SpecReader(std::string file, std::vector<Error>& errors) : file_(std::move(file)), errors_(errors) {}

  void wrong(const Literal& at, const std::string& message, const std::string& hint = {}) {
    errors_.emplace_back(ErrorCode::kGraph, Where{file_, at.line, at.column, {}, {}}, message, hint);
  }

  const Literal::Map* map(const Literal& literal, const char* what) {
    if (literal.as_map()) return literal.as_map();
    wrong(literal, std::string("expected a map of ") + what + ", found " + literal.kind());
    return nullptr;
  }

  std::string key(const Literal& literal) {
    if (const std::string* text = literal.as_string()) return *text;
    wrong(literal, std::string("expected a name, found ") + literal.kind());
    return {};
  }

  std::string text(const Literal& literal, const char* what) {
    if (const std::string* v = literal.as_string()) return *v;
    wrong(literal, std::string(what) + ": expected a text, found " + literal.kind());
    return {};
  }

  bool flag(const Literal& literal, const char* what) {
    if (const bool* v = literal.as_bool()) return *v;
    wrong(literal, std::string(what) + ": expected true or false, found " + literal.kind());
    return false;
  }

  void unknown(const Literal& key, const std::string& name, const std::vector<std::string>& known) {
    const std::string near = nearest_name(name, known);
    wrong(key, "unknown key '" + name + "'", near.empty() ? "" : "did you mean '" + near + "'?");
  }

  // Names and types are checked by the compiler, as those of graphs made by calls are.
  void nodes(const Literal& tree, std::vector<NodeSpec>& out) {
    const Literal::Map* all = map(tree, "nodes");
    if (!all) return;
    for (const auto& [name_literal, body] : *all) {
      NodeSpec node;
      node.name = key(name_literal);
      node.line = name_literal.line;
      node.column = name_literal.column;
      if (!name_literal.as_string()) continue;
      if (const Literal::Map* arguments = body.as_map()) {
        for (const auto& [argument, value] : *arguments) {
          if (key(argument) == "type")
            node.type = text(value, "type");
          else
            node.arguments.emplace_back(argument, value);
        }
      }
      out.push_back(std::move(node));
    }
  }

  void inputs(const Literal& tree, std::vector<GroupInputSpec>& out) {
    const Literal::Map* all = map(tree, "inputs");
    if (!all) return;
    for (const auto& [name, body] : *all) {
      GroupInputSpec input;
      input.name = key(name);
      if (const std::string* type = body.as_string()) {
        input.type = *type;
      } else if (const Literal::Map* fields = map(body, "type, optional, many, doc")) {
        for (const auto& [field, value] : *fields) {
          const std::string field_name = key(field);
          if (field_name == "type")
            input.type = text(value, "type");
          else if (field_name == "optional")
            input.optional = flag(value, "optional");
          else if (field_name == "many")
            input.many = flag(value, "many");
          else if (field_name == "doc")
            input.doc = text(value, "doc");
          else
            unknown(field, field_name, {"type", "optional", "many", "doc"});
        }
      }
      if (input.type.empty()) wrong(name, "input '" + input.name + "' has no type", "Surface, Sdf, Weights, ...");
      out.push_back(std::move(input));
    }
  }

  void parameters(const Literal& tree, std::vector<GroupParameterSpec>& out) {
    const Literal::Map* all = map(tree, "parameters");
    if (!all) return;
    for (const auto& [name, body] : *all) {
      GroupParameterSpec parameter;
      parameter.name = key(name);
      if (const Literal::Map* fields = body.as_map()) {
        for (const auto& [field, value] : *fields) {
          const std::string field_name = key(field);
          if (field_name == "default")
            parameter.value = value;
          else if (field_name == "doc")
            parameter.doc = text(value, "doc");
          else
            unknown(field, field_name, {"default", "doc"});
        }
        if (!body.find("default")) wrong(name, "parameter '" + parameter.name + "' has no default");
      } else {
        parameter.value = body;
      }
      out.push_back(std::move(parameter));
    }
  }

 private:
  std::string file_;
  std::vector<Error>& errors_;
};

}  // namespace

std::vector<NodeSpec> node_specs(const Literal& tree, const std::string& file, std::vector<Error>& errors) {
  std::vector<NodeSpec> nodes;
  SpecReader(file, errors).nodes(tree, nodes);
  return nodes;
}

GraphSpec GraphSpec::from_literal(const Literal& tree, const std::string& file) {
  std::vector<Error> errors;
  SpecReader reader(file, errors);
  GraphSpec spec;
  spec.file = file;
  bool versioned = false;
  if (const Literal::Map* top = reader.map(tree, "knead, frames, nodes, ...")) {
    for (const auto& [key, value] : *top) {
      const std::string name = reader.key(key);
      if (name == "knead") {
        versioned = true;
        const int64_t* version = value.as_int();
        if (!version || *version != 1) reader.wrong(value, "this program reads graph files of version 1, and this one says " + value.text());
      } else if (name == "$schema") {
        // Says to an editor what the file may hold.
      } else if (name == "description") {
        spec.description = reader.text(value, "description");
      } else if (name == "frames") {
        try {
          spec.frames = parse_frames(value);
        } catch (const Error& error) {
          reader.wrong(value, error.message(), error.hint());
        }
      } else if (name == "nodes") {
        reader.nodes(value, spec.nodes);
      } else if (name == "inputs") {
        reader.inputs(value, spec.inputs);
      } else if (name == "parameters") {
        reader.parameters(value, spec.parameters);
      } else if (name == "outputs") {
        if (const Literal::Map* outputs = reader.map(value, "outputs"))
          for (const auto& [output, reference] : *outputs) spec.outputs.emplace_back(reader.key(output), reference);
      } else {
        reader.unknown(key, name, {"knead", "description", "frames", "nodes", "inputs", "parameters", "outputs"});
      }
    }
    if (!versioned) reader.wrong(tree, "the graph file has no version", "begin it with `knead: 1`");
    if (!tree.find("nodes")) reader.wrong(tree, "the graph file has no nodes", "add `nodes:` with one line per node");
  }
  if (!errors.empty()) throw GraphErrors(std::move(errors));
  return spec;
}

static constexpr size_t kMostFrames = 1000000;

static std::vector<int> frames_of(const std::string& text) {
  constexpr const char* kExpected = "expected frames such as 12, 1-48, 1-48x2 or 1-10,20";
  std::vector<int> frames;
  const char* at = text.data();
  const char* const end = at + text.size();
  const auto number = [&] {
    while (at < end && *at == ' ') ++at;
    int value = 0;
    const auto [next, failed] = std::from_chars(at, end, value);
    if (failed != std::errc{}) throw Error(ErrorCode::kGraph, "'" + text + "' names no frames", kExpected);
    at = next;
    while (at < end && *at == ' ') ++at;
    return value;
  };
  while (true) {
    const int first = number();
    int last = first, step = 1;
    if (at < end && *at == '-') ++at, last = number();
    if (at < end && *at == 'x') ++at, step = number();
    if (step < 1) throw Error(ErrorCode::kGraph, "the frame step in '" + text + "' is not positive", kExpected);
    if (last < first) throw Error(ErrorCode::kGraph, "the frames in '" + text + "' run backwards", kExpected);
    for (int64_t frame = first; frame <= last; frame += step) {
      frames.push_back(static_cast<int>(frame));
      if (frames.size() > kMostFrames) throw Error(ErrorCode::kGraph, "'" + text + "' names more than a million frames");
    }
    if (at == end) return frames;
    if (*at++ != ',') throw Error(ErrorCode::kGraph, "'" + text + "' names no frames", kExpected);
  }
}

std::vector<int> parse_frames(const Literal& literal) {
  if (const int64_t* one = literal.as_int()) return frames_of(std::to_string(*one));
  if (const std::string* text = literal.as_string()) return frames_of(*text);
  if (const Literal::List* list = literal.as_list()) {
    std::vector<int> frames;
    for (const Literal& item : *list) {
      const std::vector<int> more = parse_frames(item);
      frames.insert(frames.end(), more.begin(), more.end());
      if (frames.size() > kMostFrames) throw Error(ErrorCode::kGraph, "the list names more than a million frames");
    }
    if (!frames.empty()) return frames;
  }
  throw Error(ErrorCode::kGraph, std::string("expected frames, found ") + literal.kind(), "such as 12, 1-48, 1-48x2 or [1-10, 20]");
}

}  // namespace knead
