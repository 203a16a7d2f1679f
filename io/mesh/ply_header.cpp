// PLY headers: elements, their properties, and what Knead takes each property for.
#include <algorithm>
#include <cmath>
#include <utility>

#include "io/mesh/ply.h"

namespace knead::mesh::ply {

std::optional<Type> type_named(std::string_view name) {
  static constexpr std::pair<std::string_view, Type> kNames[] = {
      {"char", Type::kInt8},   {"int8", Type::kInt8},     {"uchar", Type::kUint8},   {"uint8", Type::kUint8},
      {"short", Type::kInt16}, {"int16", Type::kInt16},   {"ushort", Type::kUint16}, {"uint16", Type::kUint16},
      {"int", Type::kInt32},   {"int32", Type::kInt32},   {"uint", Type::kUint32},   {"uint32", Type::kUint32},
      {"float", Type::kFloat}, {"float32", Type::kFloat}, {"double", Type::kDouble}, {"float64", Type::kDouble}};
  for (const auto& [known, type] : kNames)
    if (same_word(name, known)) return type;
  return {};
}

bool fits(Type type, double value) {
  static constexpr double kLeast[] = {-128, 0, -32768, 0, -2147483648.0, 0}, kMost[] = {127, 255, 32767, 65535, 2147483647.0, 4294967295.0};
  const auto i = static_cast<size_t>(type);
  if (type == Type::kFloat) return std::isfinite(static_cast<float>(value)) || !std::isfinite(value);
  return type == Type::kDouble || (value >= kLeast[i] && value <= kMost[i] && value == std::floor(value));
}

namespace {

// What the property is taken for, unless an earlier one of the element is that already.
void find_use(const Element& element, Property& property) {
  struct Known {
    const char* name;
    Use use;
    int part;
  };
  static constexpr Known kOfVertex[] = {{"x", Use::kPosition, 0},         {"y", Use::kPosition, 1},
                                        {"z", Use::kPosition, 2},         {"nx", Use::kNormal, 0},
                                        {"ny", Use::kNormal, 1},          {"nz", Use::kNormal, 2},
                                        {"s", Use::kTexture, 0},          {"t", Use::kTexture, 1},
                                        {"u", Use::kTexture, 0},          {"v", Use::kTexture, 1},
                                        {"texture_u", Use::kTexture, 0},  {"texture_v", Use::kTexture, 1},
                                        {"red", Use::kColour, 0},         {"green", Use::kColour, 1},
                                        {"blue", Use::kColour, 2},        {"alpha", Use::kColour, 3},
                                        {"r", Use::kColour, 0},           {"g", Use::kColour, 1},
                                        {"b", Use::kColour, 2},           {"a", Use::kColour, 3},
                                        {"diffuse_red", Use::kColour, 0}, {"diffuse_green", Use::kColour, 1},
                                        {"diffuse_blue", Use::kColour, 2}};
  static constexpr Known kOfFace[] = {{"vertex_indices", Use::kCorners, 0}, {"vertex_index", Use::kCorners, 0}, {"texcoord", Use::kCornerTexture, 0}};
  const auto take = [&](const Known& known) {
    if (!same_word(property.name, known.name)) return;
    for (const Property& other : element.properties)
      if (other.use == known.use && other.part == known.part) return;
    property.use = known.use, property.part = known.part;
  };
  if (element.name == "vertex" && !property.list) std::for_each(std::begin(kOfVertex), std::end(kOfVertex), take);
  if ((element.name == "face" || element.name == "tristrips") && property.list) std::for_each(std::begin(kOfFace), std::end(kOfFace), take);
}

// Where no list of the faces has the name that the format asks for, the only list of whole numbers must be that of the corners.
void find_corners(Element& element, Header& header) {
  if ((element.name != "face" && element.name != "tristrips") || element.has(Use::kCorners, 1)) return;
  Property* only = nullptr;
  for (Property& p : element.properties) {
    if (!p.list || p.use != Use::kNone || p.type == Type::kFloat || p.type == Type::kDouble) continue;
    if (only) return;
    only = &p;
  }
  if (!only) return;
  only->use = Use::kCorners;
  header.taken_for_corners = only->name;
}

Type read_type(TextReader& text) {
  const std::string_view word = text.word();
  const std::optional<Type> type = type_named(word);
  if (!type) text.fail(shown(word) + " is no PLY type", "PLY knows char, uchar, short, ushort, int, uint, float and double");
  return *type;
}

Property read_property(TextReader& text, const Element& element) {
  Property property;
  std::string_view word = text.word();
  if (word == "list") {
    property.list = read_type(text);
    if (*property.list == Type::kFloat || *property.list == Type::kDouble) text.fail("a list cannot have a fractional length");
    property.type = read_type(text);
  } else {
    const std::optional<Type> type = type_named(word);
    if (!type) text.fail(shown(word) + " is no PLY type", "PLY knows char, uchar, short, ushort, int, uint, float and double");
    property.type = *type;
  }
  property.name = text.word();
  if (property.name.empty()) text.fail("a property without a name");
  find_use(element, property);
  if (element.name == "vertex" && !property.list && property.use == Use::kNone &&
      (property.name == "x" || property.name == "y" || property.name == "z"))
    text.fail("a second property '" + property.name + "' of 'vertex'", "the file is damaged, or the program that wrote it is");
  return property;
}

// Somebody's own line is passed over; a misspelt declaration is not, since what follows would be read wrongly without it.
void unknown_line(TextReader& text, std::string_view keyword, Header& header) {
  const std::string_view second = text.word();
  if (second == "list" || second == "vertex" || second == "face" || second == "tristrips" || type_named(second))
    text.fail(shown(keyword) + " is no PLY header statement");
  std::string line(keyword);
  if (!second.empty()) line.append(" ").append(second).append(" ").append(text.rest());
  header.unknown_lines.add(text.line(), line);
}

}  // namespace

Header read_header(TextReader& text) {
  Header header;
  if (!text.next_line() || !same_word(text.word(), "ply")) text.fail("is no PLY file: the first line is not 'ply'", "check the file's ending");
  bool format_known = false;
  while (text.next_line()) {
    const std::string_view keyword = text.word();
    if (same_word(keyword, "end_header")) {
      if (!format_known) text.fail("the header has no 'format' line");
      for (Element& element : header.elements) find_corners(element, header);
      return header;
    }
    if (same_word(keyword, "format")) {
      const std::string_view format = text.word();
      if (format != "ascii" && format != "binary_little_endian" && format != "binary_big_endian") text.fail(shown(format) + " is no PLY format");
      header.encoding = format == "ascii" ? Encoding::kAscii : format == "binary_big_endian" ? Encoding::kBig : Encoding::kLittle;
      format_known = true;
    } else if (same_word(keyword, "element")) {
      Element element;
      element.name = text.word();
      for (const char* known : {"vertex", "face", "tristrips"})
        if (same_word(element.name, known)) element.name = known;
      const int64_t count = text.integer("a count");
      if (count < 0) text.fail("a negative count");
      element.count = static_cast<size_t>(count);
      header.elements.push_back(std::move(element));
    } else if (same_word(keyword, "property")) {
      if (header.elements.empty()) text.fail("a property before the first element");
      if (header.elements.back().properties.size() >= 1000) text.fail("more than a thousand properties");
      header.elements.back().properties.push_back(read_property(text, header.elements.back()));
    } else if (!same_word(keyword, "comment") && !same_word(keyword, "obj_info") && !keyword.empty()) {
      unknown_line(text, keyword, header);
    }
  }
  text.fail("the header has no 'end_header'", "the file is damaged or cut short");
}

}  // namespace knead::mesh::ply
