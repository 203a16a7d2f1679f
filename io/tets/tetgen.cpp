// TetGen's pair of text files: vertices in .node, tets in .ele, both counted from 0 or from 1.
#include "io/tets/tet_formats.h"

namespace knead::tets {

Found read_tetgen(const std::string& path) {
  const std::string stem = path.substr(0, path.rfind('.'));
  const std::string node_path = stem + ".node", ele_path = stem + ".ele";
  const std::string node_bytes = read_whole_file(node_path), ele_bytes = read_whole_file(ele_path);
  Found found;
  Scanner nodes(node_bytes, node_path);
  nodes.skip_comments('#');
  const size_t n = nodes.count(nodes.number<uint64_t>(), 7);
  if (nodes.number<int>() != 3) fail(node_path, "its vertices do not have three coordinates");
  const int extra = nodes.number<int>() + nodes.number<int>();  // attributes and a boundary marker
  int64_t first = 0;
  for (size_t v = 0; v < n; ++v) {
    const auto number = nodes.number<int64_t>();
    if (v == 0) first = number;
    if (number != first + static_cast<int64_t>(v) || first < 0 || first > 1)
      nodes.fail_here("vertices are not numbered one after the other from 0 or 1");
    Vec3d p;
    for (int k = 0; k < 3; ++k) p[k] = nodes.number();
    for (int k = 0; k < extra; ++k) nodes.number();
    found.mesh.points.push_back(p);
  }
  Scanner tets(ele_bytes, ele_path);
  tets.skip_comments('#');
  const size_t m = tets.count(tets.number<uint64_t>(), 9);
  const int corners = tets.number<int>(), attributes = tets.number<int>();
  if (corners != 4 && corners != 10) fail(ele_path, fmt::format("its elements have {} vertices", corners));
  for (size_t t = 0; t < m; ++t) {
    tets.number<int64_t>();
    std::array<uint32_t, 4> tet{};
    for (int k = 0; k < corners; ++k) {
      const int64_t v = tets.number<int64_t>() - first;
      if (v < 0 || v >= static_cast<int64_t>(n)) tets.fail_here(fmt::format("a tet names vertex {}, which is not there", v + first));
      if (k < 4) tet[static_cast<size_t>(k)] = static_cast<uint32_t>(v);
    }
    for (int k = 0; k < attributes; ++k) tets.number();
    found.mesh.tets.push_back(tet);
  }
  if (corners == 10) found.curved = m;
  return found;
}

}  // namespace knead::tets
