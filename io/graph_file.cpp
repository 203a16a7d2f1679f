#include "io/graph_file.h"

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "io/files.h"

namespace knead {
namespace {

constexpr int kMostDepth = 100;
constexpr size_t kMostLiterals = 1000000;
constexpr size_t kMostBytes = size_t{64} << 20;

bool all_of(std::string_view text, bool (*is)(char)) {
  return !text.empty() && std::all_of(text.begin(), text.end(), is);
}
bool is_digit(char c) {
  return c >= '0' && c <= '9';
}
bool is_octal(char c) {
  return c >= '0' && c <= '7';
}
bool is_hexadecimal(char c) {
  return is_digit(c) || (c >= 'a' && c <= 'f') || (c >= 'A' && c <= 'F');
}

Literal integer(std::string_view digits, int base, bool negative, const std::string& text) {
  int64_t value = 0;
  const std::string with_sign = (negative ? "-" : "") + std::string(digits);
  const auto [end, failed] = std::from_chars(with_sign.data(), with_sign.data() + with_sign.size(), value, base);
  if (failed == std::errc{}) return value;
  if (base != 10) return text;
  double large = 0;  // more digits than 64 bits hold: still a number
  std::from_chars(with_sign.data(), with_sign.data() + with_sign.size(), large);
  return large;
}

// [-+]? ( \. [0-9]+ | [0-9]+ ( \. [0-9]* )? ) ( [eE] [-+]? [0-9]+ )?
bool is_float(std::string_view text) {
  size_t i = 0, before = 0, after = 0;
  while (i < text.size() && is_digit(text[i])) ++i, ++before;
  if (i < text.size() && text[i] == '.') {
    ++i;
    while (i < text.size() && is_digit(text[i])) ++i, ++after;
  }
  if (before + after == 0) return false;
  if (i < text.size() && (text[i] == 'e' || text[i] == 'E')) {
    ++i;
    if (i < text.size() && (text[i] == '+' || text[i] == '-')) ++i;
    return all_of(text.substr(i), is_digit);
  }
  return i == text.size();
}

Literal plain_scalar(const std::string& text) {
  if (text.empty() || text == "~" || text == "null" || text == "Null" || text == "NULL") return {};
  if (text == "true" || text == "True" || text == "TRUE") return true;
  if (text == "false" || text == "False" || text == "FALSE") return false;
  if (text.starts_with("0x") && all_of(std::string_view(text).substr(2), is_hexadecimal))
    return integer(std::string_view(text).substr(2), 16, false, text);
  if (text.starts_with("0o") && all_of(std::string_view(text).substr(2), is_octal)) return integer(std::string_view(text).substr(2), 8, false, text);
  const bool negative = text[0] == '-';
  const std::string_view unsigned_text = std::string_view(text).substr(negative || text[0] == '+' ? 1 : 0);
  if (all_of(unsigned_text, is_digit)) return integer(unsigned_text, 10, negative, text);
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (unsigned_text == ".inf" || unsigned_text == ".Inf" || unsigned_text == ".INF") return negative ? -kInfinity : kInfinity;
  if (text == ".nan" || text == ".NaN" || text == ".NAN") return std::numeric_limits<double>::quiet_NaN();
  if (is_float(unsigned_text)) {
    double value = 0;
    std::string digits(unsigned_text);
    if (digits[0] == '.') digits.insert(0, "0");
    const auto [end, failed] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (failed == std::errc::result_out_of_range)
      value = digits.find("e-") == std::string::npos && digits.find("E-") == std::string::npos ? kInfinity : 0;
    return negative ? -value : value;
  }
  return text;
}

class TreeBuilder : public YAML::EventHandler {
 public:
  TreeBuilder(const std::string& text, std::string file) : file_(std::move(file)) {
    if (std::any_of(text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) >= 0x80; })) text_ = &text;
  }

  Literal result() {
    if (!errors_.empty()) throw GraphErrors(std::move(errors_));
    return std::move(root_);
  }

  [[noreturn]] void refuse(const YAML::Mark& mark, const std::string& message, const std::string& hint = {}) {
    wrong(place(mark, {}), message, hint);
    throw GraphErrors(std::move(errors_));
  }

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { leaf(mark, anchor, {}, false); }

  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor, const std::string& value) override {
    if (tag == "?")
      leaf(mark, anchor, plain_scalar(value), value == "<<");
    else if (tag == "!" || tag == "tag:yaml.org,2002:str")
      leaf(mark, anchor, value, false);
    else
      refuse(mark, "the tag '" + tag + "' means nothing here", "write the value without a tag");
  }

  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    const auto found = anchors_.find(anchor);
    if (found == anchors_.end()) refuse(mark, "the alias stands inside of what it repeats");
    if (static_cast<int>(open_.size()) + found->second.height > kMostDepth) refuse_depth(mark);
    count(mark, found->second.literals);
    add(mark, found->second.tree, found->second.height, false);
  }

  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor, YAML::EmitterStyle::value) override {
    begin(mark, Literal::List{}, anchor);
  }
  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor, YAML::EmitterStyle::value) override {
    begin(mark, Literal::Map{}, anchor);
  }
  void OnSequenceEnd() override { end(); }
  void OnMapEnd() override { end(); }

 private:
  struct Anchor {
    Literal tree;
    size_t literals;
    int height;
  };
  struct Open {
    Literal tree;
    YAML::Mark mark;
    YAML::anchor_t anchor;
    size_t literals_before;
    int height = 1;
    bool has_key = false, merge = false;
    Literal key;
    std::set<std::string> keys;
    Literal::Map merged;
  };

  Literal place(const YAML::Mark& mark, Literal literal) const {
    literal.line = std::max(mark.line, 0) + 1;
    literal.column = std::max(mark.column, 0) + 1;
    if (text_ && mark.pos > 0) {  // the parser counts bytes, editors count characters
      const size_t pos = std::min<size_t>(static_cast<size_t>(mark.pos), text_->size());
      const size_t start = pos - std::min<size_t>(pos, static_cast<size_t>(std::max(mark.column, 0)));
      literal.column -= static_cast<int>(std::count_if(text_->begin() + start, text_->begin() + pos, [](char c) { return (c & 0xc0) == 0x80; }));
    }
    return literal;
  }

  void wrong(const Literal& at, const std::string& message, const std::string& hint = {}) {
    errors_.emplace_back(ErrorCode::kGraph, Where{file_, at.line, at.column, {}, {}}, message, hint);
  }

  [[noreturn]] void refuse_depth(const YAML::Mark& mark) { refuse(mark, "the file nests more than " + std::to_string(kMostDepth) + " levels deep"); }

  void count(const YAML::Mark& mark, size_t literals) {
    literals_ += literals;
    if (literals_ > kMostLiterals) refuse(mark, "the file unfolds to more than a million values", "are there aliases of aliases?");
  }

  void leaf(const YAML::Mark& mark, YAML::anchor_t anchor, Literal literal, bool is_merge_key) {
    count(mark, 1);
    literal = place(mark, std::move(literal));
    if (anchor) anchors_[anchor] = {literal, 1, 0};
    add(mark, std::move(literal), 0, is_merge_key);
  }

  void begin(const YAML::Mark& mark, Literal empty, YAML::anchor_t anchor) {
    if (static_cast<int>(open_.size()) >= kMostDepth) refuse_depth(mark);
    anchors_.erase(anchor);  // not to be used before its end
    Open open{};
    open.tree = place(mark, std::move(empty));
    open.mark = mark;
    open.anchor = anchor;
    open.literals_before = literals_;
    open_.push_back(std::move(open));
    count(mark, 1);
  }

  void end() {
    Open closed = std::move(open_.back());
    open_.pop_back();
    if (Literal::Map* map = closed.tree.as_map())
      for (auto& [key, value] : closed.merged)
        if (closed.keys.insert(key.text()).second) map->emplace_back(std::move(key), std::move(value));
    if (closed.anchor) anchors_[closed.anchor] = {closed.tree, literals_ - closed.literals_before, closed.height};
    add(closed.mark, std::move(closed.tree), closed.height, false);
  }

  void add(const YAML::Mark& mark, Literal literal, int height, bool is_merge_key) {
    if (open_.empty()) {
      root_ = std::move(literal);
      return;
    }
    Open& open = open_.back();
    open.height = std::max(open.height, height + 1);
    if (Literal::List* list = std::get_if<Literal::List>(&open.tree.value)) {
      list->push_back(std::move(literal));
    } else if (!open.has_key) {
      if (literal.as_list() || literal.as_map()) refuse(mark, std::string("expected a key, found ") + literal.kind());
      open.has_key = true;
      open.merge = is_merge_key;
      open.key = std::move(literal);
      if (!is_merge_key && !open.keys.insert(open.key.text()).second) wrong(open.key, "the key " + open.key.text() + " is there twice");
    } else {
      open.has_key = false;
      if (open.merge)
        merge(mark, literal, open.merged);
      else
        open.tree.as_map()->emplace_back(std::move(open.key), std::move(literal));
    }
  }

  void merge(const YAML::Mark& mark, const Literal& from, Literal::Map& merged) {
    if (const Literal::Map* map = from.as_map()) {
      merged.insert(merged.end(), map->begin(), map->end());
    } else if (const Literal::List* list = from.as_list()) {
      for (const Literal& item : *list) {
        if (!item.as_map()) refuse(mark, std::string("`<<` merges maps, and this list holds ") + item.kind());
        merge(mark, item, merged);
      }
    } else {
      refuse(mark, std::string("`<<` merges maps, found ") + from.kind());
    }
  }

  const std::string* text_ = nullptr;  // null when it is plain ASCII
  std::string file_;
  Literal root_;
  size_t literals_ = 0;
  std::vector<Open> open_;
  std::map<YAML::anchor_t, Anchor> anchors_;
  std::vector<Error> errors_;
};

// Paths in `tree`, an argument list of a node of type `type`, and in the bodies of loops below it.
void resolve_paths(Literal::Map& arguments, const std::string& type, const std::string& folder, const std::string& out) {
  for (auto& [name, value] : arguments) {
    const std::string* argument = name.as_string();
    if (!argument) continue;
    if (const std::string* path = value.as_string(); path && *argument == "path") {
      const std::string& base = type.starts_with("write_") ? out : folder;
      if (!base.empty() && !path->empty() && (*path)[0] != '$' && std::filesystem::path(*path).is_relative())
        value.value = (std::filesystem::path(base) / *path).string();
    } else if (Literal::Map* body = value.as_map(); body && *argument == "body") {
      for (auto& [node, inner] : *body) {
        const Literal* inner_type = inner.find("type");
        if (Literal::Map* inner_arguments = inner.as_map(); inner_arguments && inner_type && inner_type->as_string())
          resolve_paths(*inner_arguments, std::string(*inner_type->as_string()), folder, out);
      }
    }
  }
}

std::string read_text(const std::string& path) {
  const Where where{path, 0, 0, {}, {}};
  const Error too_large(ErrorCode::kFile, where, "this is no graph file: it is larger than 64 MiB");
  std::error_code ignored;
  if (!std::filesystem::is_other(path, ignored)) {
    if (std::filesystem::is_regular_file(path, ignored) && std::filesystem::file_size(path, ignored) > kMostBytes) throw too_large;
    return read_whole_file(path);
  }
  std::ifstream in(path, std::ios::binary);  // a pipe or a device, perhaps without an end
  if (!in) throw Error(ErrorCode::kFile, where, std::string("cannot be read: ") + std::strerror(errno));
  std::string text;
  char block[1 << 16];
  while (in.read(block, sizeof block) || in.gcount() > 0) {
    text.append(block, static_cast<size_t>(in.gcount()));
    if (text.size() > kMostBytes) throw too_large;
  }
  return text;
}

// Where a line up to `last` is indented by a tab, which YAML forbids and its parser calls something else. Null when none is.
std::optional<Where> tab_in_indentation(const std::string& text, const std::string& file, int last) {
  int line = 1;
  for (size_t start = 0; start < text.size() && line <= last; ++line) {
    const size_t first = std::min(text.find_first_not_of(" -", start), text.size());
    if (first < text.size() && text[first] == '\t') return Where{file, line, static_cast<int>(first - start) + 1, {}, {}};
    start = std::min(text.find('\n', start), text.size() - 1) + 1;
  }
  return std::nullopt;
}

}  // namespace

Literal parse_yaml(const std::string& text, const std::string& file) {
  TreeBuilder builder(text, file);
  if (const size_t zero = text.find('\0'); zero != std::string::npos) {
    const auto line = static_cast<int>(std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(zero), '\n'));
    throw GraphErrors({Error(ErrorCode::kGraph, Where{file, line + 1, 0, {}, {}}, "not a graph file: it holds a zero byte")});
  }
  try {
    std::istringstream in(text);
    YAML::Parser parser(in);
    parser.HandleNextDocument(builder);
    Literal tree = builder.result();
    TreeBuilder another(text, file);
    if (parser.HandleNextDocument(another)) {
      const Literal extra = another.result();
      throw GraphErrors(
          {Error(ErrorCode::kGraph, Where{file, extra.line, extra.column, {}, {}}, "a second document begins here", "one file holds one graph")});
    }
    return tree;
  } catch (const YAML::Exception& error) {
    if (const auto tab = tab_in_indentation(text, file, error.mark.line + 2))
      throw GraphErrors({Error(ErrorCode::kGraph, *tab, "not valid YAML: the line is indented by a tab", "indent by spaces")});
    builder.refuse(error.mark, "not valid YAML: " + error.msg);
  }
}

GraphSpec read_graph_text(const std::string& text, const std::string& file, const std::string& out) {
  GraphSpec spec = GraphSpec::from_literal(parse_yaml(text, file), file);
  const std::string folder = std::filesystem::path(file).parent_path().string();
  for (NodeSpec& node : spec.nodes) resolve_paths(node.arguments, node.type, folder, out);
  return spec;
}

GraphSpec read_graph_file(const std::string& path, const std::string& out) {
  return read_graph_text(read_text(path), path, out);
}

CompileOptions graph_file_options(const std::string& out) {
  CompileOptions options;
  options.load_group = [out](const std::string& path) { return read_graph_file(path, out); };
  return options;
}

}  // namespace knead
