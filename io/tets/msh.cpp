// Gmsh's format: versions 2.2 and 4.1, text and binary. Written as 4.1 in text.
#include <unordered_map>

#include "io/tets/tet_formats.h"

namespace knead::tets {
namespace {

// Vertices by Gmsh's number of an element's type, 1 to 31; 0: a type whose size depends on more.
constexpr std::array<uint8_t, 32> kVertices{0, 2,  3,  4,  4, 8,  6,  5,  3,  6,  9, 10, 27, 18, 14, 1,
                                            8, 20, 15, 13, 9, 10, 12, 15, 15, 21, 4, 5,  6,  20, 35, 56};

int dimension_of(int type) {
  constexpr std::string_view kFlat = "\x01\x02\x03\x08\x09\x0a\x0f\x10\x14\x15\x16\x17\x18\x19\x1a\x1b\x1c";
  return kFlat.find(static_cast<char>(type)) != std::string_view::npos ? 2 : 3;
}

class MshReader {
 public:
  MshReader(const std::string& bytes, const std::string& path) : bytes_(bytes), path_(path), in_(bytes, path) {}

  Found read() {
    for (std::string_view section = in_.word(); !section.empty(); section = in_.word()) {
      if (section == "$MeshFormat") {
        read_format();
      } else if (section == "$Nodes" && version_ > 0) {
        version_ >= 4 ? read_nodes_4() : read_nodes_2();
        has_nodes_ = true;
      } else if (section == "$Elements" && version_ > 0) {
        version_ >= 4 ? read_elements_4() : read_elements_2();
        has_elements_ = true;
      } else if (section.starts_with("$") && !section.starts_with("$End")) {
        skip_section(section);
      }
    }
    if (version_ == 0) fail(path_, "has no $MeshFormat: it is no Gmsh file");
    if (!has_nodes_ || !has_elements_) fail(path_, "ends before its $Nodes and $Elements");
    return std::move(found_);
  }

 private:
  void read_format() {
    version_ = in_.number();
    binary_ = in_.number<int>() == 1;
    const int size = in_.number<int>();
    if (!(version_ >= 2 && version_ < 3) && version_ != 4.1)
      fail(path_, fmt::format("is of Gmsh's format {}", version_), "write it as 4.1 or 2.2 (gmsh -format msh41)");
    if (size != 8) fail(path_, fmt::format("has numbers of {} bytes", size));
    in_.line();
    if (binary_) {
      const auto one = in_.raw<int32_t>();
      swapped_ = one == 1 << 24;
      if (one != 1 && !swapped_) fail(path_, "its binary part does not begin with a 1");
    }
  }
  void skip_section(std::string_view section) {
    const std::string end = "$End" + std::string(section.substr(1));
    const size_t at = bytes_.find(end, in_.at());
    if (at == std::string::npos) fail(path_, fmt::format("'{}' does not end", section.substr(0, 40)));
    in_.go_to(at + end.size());
  }
  template <class T>
  T number() {
    return binary_ ? in_.raw<T>(swapped_) : in_.number<T>();
  }
  uint64_t size() { return number<uint64_t>(); }
  void start_section() {
    if (binary_) in_.line();
  }

  void add_node(uint64_t tag, const Vec3d& p) {
    if (!number_of_.emplace(tag, static_cast<uint32_t>(found_.mesh.points.size())).second)
      in_.fail_here(fmt::format("two nodes have the number {}", tag));
    found_.mesh.points.push_back(p);
  }
  Vec3d place() {
    Vec3d p;
    for (int k = 0; k < 3; ++k) p[k] = number<double>();
    return p;
  }

  void read_nodes_2() {
    const auto n = in_.count(in_.number<uint64_t>(), 7);
    start_section();
    for (size_t i = 0; i < n; ++i) {
      const auto tag = static_cast<uint64_t>(binary_ ? number<int32_t>() : in_.number<int64_t>());
      add_node(tag, place());
    }
  }
  void read_nodes_4() {
    start_section();
    const uint64_t blocks = size();
    for (int k = 0; k < 3; ++k) size();
    for (uint64_t b = 0; b < blocks; ++b) {
      const int dimension = number<int32_t>();
      number<int32_t>();
      const int parametric = number<int32_t>();
      const size_t n = in_.count(size(), 2);
      std::vector<uint64_t> tags(n);
      for (uint64_t& tag : tags) tag = size();
      for (const uint64_t tag : tags) {
        add_node(tag, place());
        for (int k = 0; parametric != 0 && k < dimension; ++k) number<double>();
      }
    }
  }

  void take(int type, std::span<const uint64_t> nodes) {
    if (type != 4 && type != 11 && type != 29 && type != 30 && type != 31) {
      ++(dimension_of(type) == 3 ? found_.other : found_.flat);
      return;
    }
    found_.curved += type != 4;
    std::array<uint32_t, 4> tet;
    for (size_t k = 0; k < 4; ++k) {
      const auto number = number_of_.find(nodes[k]);
      if (number == number_of_.end()) in_.fail_here(fmt::format("an element names node {}, which is not there", nodes[k]));
      tet[k] = number->second;
    }
    found_.mesh.tets.push_back(tet);
  }
  size_t vertices_of(int type) {
    if (type < 1 || type >= static_cast<int>(kVertices.size())) in_.fail_here(fmt::format("elements of type {} are not understood", type));
    return kVertices[static_cast<size_t>(type)];
  }
  void read_elements_2() {
    const auto n = in_.count(in_.number<uint64_t>(), 4);
    start_section();
    std::vector<uint64_t> nodes;
    for (size_t i = 0; i < n;) {
      int type = 0, tags = 0, together = 1;
      if (binary_) {
        type = number<int32_t>(), together = number<int32_t>(), tags = number<int32_t>();
        if (together < 1) in_.fail_here("a block of elements is empty");
      } else {
        in_.number<int64_t>();
        type = in_.number<int>(), tags = in_.number<int>();
      }
      nodes.resize(vertices_of(type));
      for (int e = 0; e < together; ++e, ++i) {
        if (binary_) number<int32_t>();
        for (int t = 0; t < tags; ++t) binary_ ? number<int32_t>() : in_.number<int64_t>();
        for (uint64_t& node : nodes) node = binary_ ? static_cast<uint64_t>(number<int32_t>()) : in_.number<uint64_t>();
        take(type, nodes);
      }
    }
  }
  void read_elements_4() {
    start_section();
    const uint64_t blocks = size();
    for (int k = 0; k < 3; ++k) size();
    std::vector<uint64_t> nodes;
    for (uint64_t b = 0; b < blocks; ++b) {
      number<int32_t>();
      number<int32_t>();
      const int type = number<int32_t>();
      const size_t n = in_.count(size(), 2);
      nodes.resize(vertices_of(type));
      for (size_t e = 0; e < n; ++e) {
        size();
        for (uint64_t& node : nodes) node = size();
        take(type, nodes);
      }
    }
  }

  const std::string& bytes_;
  const std::string& path_;
  Scanner in_;
  double version_ = 0;
  bool binary_ = false, swapped_ = false, has_nodes_ = false, has_elements_ = false;
  Found found_;
  std::unordered_map<uint64_t, uint32_t> number_of_;  // Gmsh numbers nodes as it likes
};

}  // namespace

Found read_msh(const std::string& bytes, const std::string& path) {
  return MshReader(bytes, path).read();
}

std::string msh_text(const TetFile& mesh, const std::vector<TetField>& fields) {
  const size_t n = mesh.points.size(), m = mesh.tets.size();
  std::string text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n";
  const auto to = std::back_inserter(text);
  Vec3d lower = n > 0 ? mesh.points[0] : Vec3d{0, 0, 0}, upper = lower;
  for (const Vec3d& p : mesh.points)
    for (int k = 0; k < 3; ++k) lower[k] = std::min(lower[k], p[k]), upper[k] = std::max(upper[k], p[k]);
  fmt::format_to(to, "$Entities\n0 0 0 1\n1 {} {} {} {} {} {} 0 0\n$EndEntities\n", lower.x, lower.y, lower.z, upper.x, upper.y, upper.z);
  fmt::format_to(to, "$Nodes\n1 {} 1 {}\n3 1 0 {}\n", n, n, n);
  for (size_t v = 1; v <= n; ++v) fmt::format_to(to, "{}\n", v);
  for (const Vec3d& p : mesh.points) fmt::format_to(to, "{} {} {}\n", p.x, p.y, p.z);
  fmt::format_to(to, "$EndNodes\n$Elements\n1 {} 1 {}\n3 1 4 {}\n", m, m, m);
  for (size_t t = 0; t < m; ++t)
    fmt::format_to(to, "{} {} {} {} {}\n", t + 1, mesh.tets[t][0] + 1, mesh.tets[t][1] + 1, mesh.tets[t][2] + 1, mesh.tets[t][3] + 1);
  text += "$EndElements\n";
  for (const TetField& field : fields) {
    const auto components = static_cast<size_t>(field.components);
    const char* section = field.by_tet ? "ElementData" : "NodeData";
    const size_t count = field.values.size() / components;
    fmt::format_to(to, "${}\n1\n\"{}\"\n1\n0\n3\n0\n{}\n{}\n", section, field.name, components, count);
    for (size_t i = 0; i < count; ++i) {
      fmt::format_to(to, "{}", i + 1);
      for (size_t k = 0; k < components; ++k) fmt::format_to(to, " {}", field.values[i * components + k]);
      text += '\n';
    }
    fmt::format_to(to, "$End{}\n", section);
  }
  return text;
}

}  // namespace knead::tets
