// Inside io/mesh/ply*.cpp only: what a PLY header says.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "io/mesh/raw_mesh.h"

namespace knead::mesh::ply {

enum class Type : uint8_t { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };
constexpr size_t kTypeBytes[] = {1, 1, 2, 2, 4, 4, 4, 8};
constexpr const char* kTypeNames[] = {"char", "uchar", "short", "ushort", "int", "uint", "float", "double"};
constexpr double kWholeColour[] = {127, 255, 32767, 65535, 2147483647.0, 4294967295.0, 1, 1};

enum class Use : uint8_t { kNone, kPosition, kNormal, kTexture, kColour, kCorners, kCornerTexture };

struct Property {
  std::string name;
  Type type = Type::kFloat;
  std::optional<Type> list;  // type of the count
  Use use = Use::kNone;
  int part = 0;
};

struct Element {
  std::string name;
  size_t count = 0;
  std::vector<Property> properties;
  bool has(Use use, int parts) const {
    int found = 0;
    for (const Property& p : properties) found += p.use == use && p.part < parts;
    return found >= parts;
  }
};

enum class Encoding { kAscii, kLittle, kBig };

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
  LeftOut unknown_lines;
  std::string taken_for_corners;  // the name of a list that is none of the known ones
};

// From the first line to the one after end_header.
Header read_header(TextReader& text);

std::optional<Type> type_named(std::string_view name);
bool fits(Type type, double value);  // exactly; a float fits when it stays finite

}  // namespace knead::mesh::ply
