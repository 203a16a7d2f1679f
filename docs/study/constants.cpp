// What each constant of the equilibrium's solver is good for: every scene once as it is, then with each constant at half and at double its value. Writes the
// table of docs/convergence.md as Markdown. Constants that are counts are rounded down, and up to at least 1.
//
//   constants SHARED_DATA [CONSTANT]...
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <string>
#include <vector>

#include "graph/evaluator.h"
#include "io/graph_file.h"
#include "kernels/equilibrium/equilibrium.h"

namespace {

using namespace knead;

// Nodes `body`, `tets` and the fields in `colliders`.
struct SceneText {
  const char* name;
  std::vector<const char*> colliders;
  std::string nodes;
  Vec3d entry{0, 0, 0};
  int contact_samples = 0;
};

std::vector<SceneText> scene_texts(const std::string& data) {
  const auto ball_on = [&](const char* path) {
    return "\n  body: {type: read_mesh, path: " + data + path + R"(}
  ball: {type: primitive, shape: sphere, resolution: 5, radius: RADIUS, centre: CENTRE}
  solid: {type: mesh_to_sdf, mesh: ball}
  tets: {type: build_tets, surface: body}
)";
  };
  return {
      {"head", {"solid"}, R"(
  body: {type: primitive, shape: head}
  fist: {type: primitive, shape: fist, height: 0.6}
  motion: {type: transform, mesh: fist, rotate: [-90, 0, 0], translate: [0.28, 0, 0.72]}
  solid: {type: mesh_to_sdf, mesh: motion}
  tets: {type: build_tets, surface: body}
)"},
      {"crush", {"upper", "lower"}, R"(
  body: {type: primitive, shape: sphere, radius: 1, resolution: 5}
  block: {type: primitive, shape: box, size: [6, 4, 6], resolution: 6}
  above: {type: transform, mesh: block, translate: [0, 2.27, 0]}
  below: {type: transform, mesh: block, translate: [0, -2.27, 0]}
  upper: {type: mesh_to_sdf, mesh: above}
  lower: {type: mesh_to_sdf, mesh: below}
  tets: {type: build_tets, surface: body, max_depth: 5, max_vertices: 1}
)"},
      {"sdf_pipeline", {"ring", "left", "right"}, R"(
  capsule: {type: primitive, shape: capsule, radius: 0.36, height: 1.6, resolution: 16}
  body: {type: transform, mesh: capsule, translate: [0, 0.1, 0]}
  torus: {type: primitive, shape: torus, radius: 0.45, tube: 0.14}
  ring: {type: mesh_to_sdf, mesh: torus, voxel_size: 0.02}
  ball: {type: primitive, shape: sphere, radius: 0.3}
  at_left: {type: transform, mesh: ball, translate: [-0.52, 0.55, 0]}
  at_right: {type: transform, mesh: ball, translate: [0.5, 0.5, 0.1]}
  left: {type: mesh_to_sdf, mesh: at_left}
  right: {type: mesh_to_sdf, mesh: at_right}
  tets: {type: build_tets, surface: body}
)"},
      {"spot", {"solid"}, ball_on("/organic/spot_2930.obj")},
      {"ICT head", {"solid"}, ball_on("/heads/head_ict_2400.obj")},
      {"penguin", {"solid"}, ball_on("/organic/penguin_3362.obj")},
      {"press",
       {"solid"},
       R"(
  body: {type: primitive, shape: box, size: [1, 1, 1], centre: [0, 0, 0.5], resolution: 20}
  ball: {type: primitive, shape: sphere, radius: 0.35, resolution: 5, centre: [0.03, 0.02, 1.0]}
  solid: {type: mesh_to_sdf, mesh: ball}
  tets: {type: build_tets, surface: body, max_depth: 4}
)",
       {0, 0, 0},
       4},
      {"sweep",
       {"solid"},
       R"(
  body: {type: primitive, shape: sphere, radius: 1}
  ball: {type: primitive, shape: sphere, radius: 0.2, centre: [0.05, 0.7, 0]}
  solid: {type: mesh_to_sdf, mesh: ball}
  tets: {type: build_tets, surface: body, max_depth: 4}
)",
       {0, -1, 0}},
  };
}

// A ball of a seventh of the diagonal, where the body reaches furthest along z, in by 6 % of the diagonal.
void place_ball(std::string& nodes, const std::string& body) {
  if (nodes.find("RADIUS") == std::string::npos) return;
  Evaluator evaluator(compile(read_graph_text("knead: 1\nnodes:\n" + body, "constants")));
  const auto surface = evaluator.get<Surface>("body", 1);
  Vec3d lower{1e30, 1e30, 1e30}, upper = -lower, tip{0, 0, -1e30};
  for (const Vec3f& p : surface.points.host()) {
    const Vec3d x = surface.placement.apply(to_double(p));
    for (int k = 0; k < 3; ++k) lower[k] = std::min(lower[k], x[k]), upper[k] = std::max(upper[k], x[k]);
    if (x.z > tip.z) tip = x;
  }
  const double diagonal = length(upper - lower), radius = diagonal / 7;
  char centre[120], size[40];
  std::snprintf(centre, sizeof centre, "[%.9g, %.9g, %.9g]", tip.x, tip.y, tip.z + radius - 0.06 * diagonal);
  std::snprintf(size, sizeof size, "%.9g", radius);
  for (const auto& [word, to] : {std::pair("RADIUS", size), std::pair("CENTRE", centre)})
    nodes.replace(nodes.find(word), std::string(word).size(), to);
}

struct Outcome {
  Ended ended = Ended::kNoContact;
  int iterations = 0;
  size_t inverted = 0;
  double seconds = 0;  // of the processor
  std::vector<Vec3f> points;
};

class Scene {
 public:
  explicit Scene(const SceneText& text) : name(text.name) {
    std::string nodes = text.nodes;
    const size_t line = nodes.find("  body:");
    place_ball(nodes, nodes.substr(line, nodes.find('\n', line) + 1 - line));
    Evaluator evaluator(compile(read_graph_text("knead: 1\nnodes:\n" + nodes, text.name)));
    tets_ = evaluator.get<TetMesh>("tets", 1);
    lattice_ = evaluator.get<Lattice>("tets.lattice", 1);
    placement_ = evaluator.get<Surface>("body", 1).placement;
    for (const char* collider : text.colliders) fields_.push_back(evaluator.get<Sdf>(collider, 1));
    EquilibriumMaterial material;
    material.contact_samples = text.contact_samples;
    rest_ = prepare_equilibrium(*executor_, tets_, lattice_, material);
    entry_ = text.entry;
    diagonal_ = lattice_.rest.diagonal() / lattice_.to_local.scale;
  }

  Outcome solve(const EquilibriumConstants& constants) const {
    std::vector<const Sdf*> colliders;
    for (const Sdf& field : fields_) colliders.push_back(&field);
    EquilibriumSettings settings;
    settings.constants = constants;
    settings.entry = entry_;
    EquilibriumFigures figures;
    const std::clock_t begin = std::clock();
    const Buffer<Vec3f> moved = solve_equilibrium(*executor_, *rest_, placement_, colliders, settings, figures);
    Outcome outcome{figures.ended, figures.iterations, 0, static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC, {}};
    outcome.points.assign(moved.host().begin(), moved.host().end());
    for (const auto& t : tets_.tets.host()) {
      const Vec3d a = to_double(outcome.points[t[0]]);
      const auto edge = [&](size_t c) { return to_double(outcome.points[t[c]]) - a; };
      outcome.inverted += dot(edge(1), cross(edge(2), edge(3))) <= 0;
    }
    return outcome;
  }

  // RMS over H, of M's diagonal.
  double apart(const Outcome& a, const Outcome& b) const {
    double squares = 0;
    for (size_t i = 0; i < a.points.size(); ++i) squares += std::pow(static_cast<double>(length(a.points[i] - b.points[i])), 2);
    return std::sqrt(squares / static_cast<double>(a.points.size())) / diagonal_;
  }

  std::string name;
  size_t vertices() const { return tets_.vertices(); }

 private:
  std::unique_ptr<Executor> executor_ = make_serial_executor();
  TetMesh tets_;
  Lattice lattice_;
  Similarity placement_;
  std::vector<Sdf> fields_;
  std::shared_ptr<const EquilibriumRest> rest_;
  Vec3d entry_;
  double diagonal_ = 1;
};

struct Constant {
  const char* name;
  double& (*of)(EquilibriumConstants&);
  bool is_count;
};

#define KNEAD_CONSTANT(group, member, is_count)                                                      \
  {                                                                                                  \
#group "." #member, [](EquilibriumConstants & c) -> double& { return c.group.member; }, is_count \
  }

const Constant kConstants[] = {
    KNEAD_CONSTANT(start, small_vertices, false),
    KNEAD_CONSTANT(start, first_nodes, false),
    KNEAD_CONSTANT(start, least_on_grid, true),
    KNEAD_CONSTANT(start, worth_staying, false),
    KNEAD_CONSTANT(metric, interval, true),
    KNEAD_CONSTANT(metric, coarse_first, true),
    KNEAD_CONSTANT(metric, coarse_interval, true),
    KNEAD_CONSTANT(metric, least_scale, false),
    KNEAD_CONSTANT(metric, forget_before, true),
    KNEAD_CONSTANT(metric, tolerance, false),
    KNEAD_CONSTANT(metric, volume_interval, true),
    KNEAD_CONSTANT(multiplier, soon, true),
    KNEAD_CONSTANT(multiplier, soon_gradient, false),
    KNEAD_CONSTANT(multiplier, way_in_gradient, false),
    KNEAD_CONSTANT(multiplier, patience, true),
    KNEAD_CONSTANT(multiplier, progress, false),
    KNEAD_CONSTANT(multiplier, stiffest, false),
    KNEAD_CONSTANT(multiplier, volume_stiffness, false),
    KNEAD_CONSTANT(way_in, iterations_on_side, true),
    KNEAD_CONSTANT(way_in, stride, false),
    KNEAD_CONSTANT(way_in, renewal, true),
    KNEAD_CONSTANT(way_in, deep, false),
    KNEAD_CONSTANT(way_in, of_thickness, false),
    KNEAD_CONSTANT(way_in, most_steps, false),
    KNEAD_CONSTANT(way_in, one_side, false),
    KNEAD_CONSTANT(stopping, volume, false),
    KNEAD_CONSTANT(stopping, mean_penetration, false),
    KNEAD_CONSTANT(stopping, still, false),
    KNEAD_CONSTANT(stopping, still_steps, true),
    KNEAD_CONSTANT(line_search, sufficient_decrease, false),
    KNEAD_CONSTANT(line_search, energy_rounding, false),
    KNEAD_CONSTANT(line_search, shorter, false),
    KNEAD_CONSTANT(line_search, longer, false),
    KNEAD_CONSTANT(contact, gap_pressure, false),
    KNEAD_CONSTANT(contact, most_of_band, false),
};

// "34", "150 iterations", "34, 2 inverted"
std::string told(const Outcome& outcome) {
  std::string text = std::to_string(outcome.iterations);
  if (outcome.ended != Ended::kAtRest) text += std::string(" ") + text_of(outcome.ended);
  if (outcome.inverted > 0) text += ", " + std::to_string(outcome.inverted) + " inverted";
  return text;
}

void study(const std::string& data, const std::vector<std::string>& only) {
  std::vector<Scene> scenes;
  for (const SceneText& text : scene_texts(data)) scenes.emplace_back(text);
  std::vector<Outcome> as_is;
  double seconds = 0;
  std::string head = "| constant | value |", rule = "|---|---|", first = "| as it is | |";
  for (const Scene& scene : scenes) {
    as_is.push_back(scene.solve({}));
    seconds += as_is.back().seconds;
    head += " " + scene.name + " |";
    rule += "---|";
    first += " " + told(as_is.back()) + " |";
    std::fprintf(stderr, "%s: %zu vertices of H\n", scene.name.c_str(), scene.vertices());
  }
  std::printf("%s time | apart |\n%s---|---|\n%s %.1f s | |\n", head.c_str(), rule.c_str(), first.c_str(), seconds);
  for (const Constant& constant : kConstants) {
    if (!only.empty() && std::find(only.begin(), only.end(), constant.name) == only.end()) continue;
    for (const double factor : {0.5, 2.0}) {
      EquilibriumConstants constants;
      double& value = constant.of(constants);
      value *= factor;
      if (constant.is_count) value = std::max(factor < 1 ? 0.0 : 1.0, std::floor(value));
      std::printf("| %s | %.3g |", factor < 1 ? (std::string("`") + constant.name + "`").c_str() : "", value);
      double here = 0, apart = 0;
      for (size_t k = 0; k < scenes.size(); ++k) {
        const Outcome outcome = scenes[k].solve(constants);
        here += outcome.seconds;
        apart = std::max(apart, scenes[k].apart(outcome, as_is[k]));
        const bool same = outcome.points.size() == as_is[k].points.size() && scenes[k].apart(outcome, as_is[k]) == 0;
        std::printf(" %s |", same ? "=" : told(outcome).c_str());
      }
      std::printf(" %+.0f %% | %.1e |\n", 100 * (here / seconds - 1), apart);
      std::fflush(stdout);
    }
  }
}

}  // namespace

int main(int count, char** words) try {
  if (count < 2) {
    std::fputs("constants SHARED_DATA [CONSTANT]...\n", stderr);
    return 3;
  }
  study(words[1], {words + 2, words + count});
  return 0;
} catch (const knead::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
