// The press block for another solver: writes the tets of H, the rigid ball and what `equilibrium` makes of them, so that a finite element program can
// be run on the very same elements (docs/study/calculix.py).
//
// The block's size is chosen so that H, which sticks out of M a little, is the block [-0.5, 0.5]^2 x [0, 1] itself. M is then H's own boundary, every
// vertex of M a vertex of H: both programs see contact at the same points of the same body.
//
//   press_tets DEPTH POISSON_RATIO BALL_X BALL_Y BALL_Z RADIUS FOLDER
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "graph/evaluator.h"
#include "kernels/build_tets/build_tets.h"
#include "kernels/build_tets/lattice_coordinates.h"
#include "kernels/equilibrium/equilibrium.h"
#include "kernels/shapes/primitives.h"

namespace {

using namespace knead;

constexpr double kPadded = 1.03125;  // edge of the octree's box over the edge of M's

template <class Rows>
void write_rows(const std::string& path, const Rows& rows) {
  std::ofstream file(path);
  file.precision(9);
  for (const auto& row : rows) {
    for (size_t k = 0; k < row.size(); ++k) file << (k ? " " : "") << row[k];
    file << '\n';
  }
  if (!file.flush()) throw Error(ErrorCode::kFile, path + " cannot be written");
}

std::vector<std::array<double, 3>> in_world(std::span<const Vec3f> points, const Similarity& placement) {
  std::vector<std::array<double, 3>> rows;
  for (const Vec3f& p : points) {
    const Vec3d at = placement.apply(to_double(p));
    rows.push_back({at.x, at.y, at.z});
  }
  return rows;
}

// Faces that one tet only has, outward.
std::vector<std::array<uint32_t, 3>> boundary_of(const TetMesh& tets) {
  constexpr int kFaces[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
  std::map<std::array<uint32_t, 3>, std::pair<int, std::array<uint32_t, 3>>> faces;
  for (const auto& tet : tets.tets.host())
    for (const auto& corners : kFaces) {
      const std::array<uint32_t, 3> face{tet[corners[0]], tet[corners[1]], tet[corners[2]]};
      std::array<uint32_t, 3> sorted = face;
      std::sort(sorted.begin(), sorted.end());
      auto& found = faces[sorted];
      ++found.first;
      found.second = face;
    }
  std::vector<std::array<uint32_t, 3>> outside;
  for (const auto& [sorted, found] : faces)
    if (found.first == 1) outside.push_back(found.second);
  return outside;
}

// M as H's boundary, and the lattice that binds each of its vertices to its own vertex of H.
Lattice bind_boundary(const BuiltTets& build, const std::vector<std::array<uint32_t, 3>>& faces, std::vector<uint32_t>& of_tets, Executor& executor) {
  std::map<uint32_t, uint32_t> number;
  std::vector<Vec3f> points;
  std::vector<uint32_t> triangles;
  LatticeRows rows;
  rows.offsets = {0};
  for (const auto& face : faces)
    for (const uint32_t v : face) {
      if (number.try_emplace(v, static_cast<uint32_t>(number.size())).second) {
        points.push_back(to_float(build.tets.to_local.apply(to_double(build.tets.rest.host()[v]))));
        of_tets.push_back(v);
        rows.indices.push_back(v);
        rows.weights.push_back(1);
        rows.offsets.push_back(static_cast<uint32_t>(rows.indices.size()));
      }
      triangles.push_back(number.at(v));
    }
  Lattice lattice;
  lattice.rest = make_triangle_surface(points, triangles);
  lattice.rest.placement = build.lattice.rest.placement;
  lattice.tet_rest = build.tets.rest;
  lattice.to_local = build.tets.to_local;
  const std::vector<uint8_t> used(points.size(), 1);
  fill_lattice_tables(rows, used, static_cast<uint32_t>(build.tets.vertices()), lattice, executor);
  return lattice;
}

BuiltTets build_block(int depth, const Vec3d& centre, Executor& executor) {
  const double edge = 1 / kPadded;
  GraphSpec graph;
  graph.add("block", "primitive",
            {{"shape", "box"},
             {"size", Literal::List{edge, edge, edge}},
             {"resolution", 2 << depth},
             {"centre", Literal::List{centre.x, centre.y, centre.z}}});
  std::vector<std::string> warnings;
  BuildTetsOptions options;
  options.max_depth = depth;
  return build_tets(Evaluator(compile(graph)).get<Surface>("block", 1), options, executor, warnings);
}

Vec3d lower_corner(const BuiltTets& build) {
  constexpr double kFar = 1e30;
  Vec3d lower{kFar, kFar, kFar};
  for (const auto& p : in_world(build.tets.rest.host(), build.lattice.rest.placement * build.tets.to_local))
    lower = {std::min(lower.x, p[0]), std::min(lower.y, p[1]), std::min(lower.z, p[2])};
  return lower;
}

void press(int depth, double poisson_ratio, const std::array<double, 3>& centre, double radius, const std::string& folder) {
  const auto executor = make_cpu_executor();
  // The octree's box is not about M's middle: M is moved until H stands where the block should.
  const Vec3d corner{-0.5, -0.5, 0}, middle{0, 0, 0.5};
  const BuiltTets build = build_block(depth, middle + (corner - lower_corner(build_block(depth, middle, *executor))), *executor);
  GraphSpec graph;
  const Literal::List at{centre[0], centre[1], centre[2]};
  graph.add("ball", "primitive", {{"shape", "sphere"}, {"radius", radius}, {"resolution", 5}, {"centre", at}})
      .add("solid", "mesh_to_sdf", {{"mesh", "ball"}, {"voxel_size", radius / 100}});
  Evaluator evaluator(compile(graph));
  const auto faces = boundary_of(build.tets);
  std::vector<uint32_t> of_tets;
  const Lattice lattice = bind_boundary(build, faces, of_tets, *executor);
  const Similarity to_world = lattice.rest.placement * build.tets.to_local;

  const auto rest = in_world(build.tets.rest.host(), to_world);
  std::vector<float> pinned;
  for (const uint32_t v : of_tets) pinned.push_back(rest[v][2] < 1e-6 ? 1.0f : 0.0f);
  const Buffer<float> pins(pinned);
  write_rows(folder + "/nodes.txt", rest);
  write_rows(folder + "/tets.txt", build.tets.tets.host());
  write_rows(folder + "/faces.txt", faces);
  const auto ball = evaluator.get<Surface>("ball", 1);
  write_rows(folder + "/ball_nodes.txt", in_world(ball.points.host(), ball.placement));
  std::vector<std::array<uint32_t, 3>> ball_faces;
  for (size_t t = 0; t < ball.topology->triangle_count(); ++t)
    ball_faces.push_back({ball.topology->triangles[3 * t], ball.topology->triangles[3 * t + 1], ball.topology->triangles[3 * t + 2]});
  write_rows(folder + "/ball_faces.txt", ball_faces);

  const auto solid = evaluator.get<Sdf>("solid", 1);
  const std::pair<const char*, ElasticTerm> terms[] = {
      {"stable_neo_hookean", ElasticTerm::kStableNeoHookean}, {"corotated", ElasticTerm::kCorotated}, {"edges", ElasticTerm::kEdges}};
  for (const auto& [name, term] : terms) {
    EquilibriumMaterial material;
    material.term = term;
    material.poisson_ratio = poisson_ratio;
    material.hold = 0;
    material.keep_volume = false;
    material.pins = &pins;
    EquilibriumSettings settings;
    settings.contact_gap = 0;
    settings.threshold = 1e-4;
    settings.displacement = 1e-5;
    settings.penetration = 1e-5;
    settings.max_iterations = 3000;
    EquilibriumFigures figures;
    const auto prepared = prepare_equilibrium(*executor, build.tets, lattice, material);
    const Buffer<Vec3f> moved = solve_equilibrium(*executor, *prepared, lattice.rest.placement, {std::vector<const Sdf*>{&solid}}, settings, figures);
    write_rows(folder + "/" + name + ".txt", in_world(moved.host(), to_world));
    std::printf("%s %s iterations %d gradient %.3g contact_error %.3g least_tet %.3f seconds %.3f\n", name, text_of(figures.ended),
                figures.iterations, figures.gradient, figures.penetration, figures.least_volume, figures.seconds);
  }
}

}  // namespace

int main(int count, char** words) try {
  if (count != 8) {
    std::fputs("press_tets DEPTH POISSON_RATIO BALL_X BALL_Y BALL_Z RADIUS FOLDER\n", stderr);
    return 3;
  }
  press(std::stoi(words[1]), std::stod(words[2]), {std::stod(words[3]), std::stod(words[4]), std::stod(words[5])}, std::stod(words[6]), words[7]);
  return 0;
} catch (const knead::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
