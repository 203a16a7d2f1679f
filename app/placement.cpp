#include "app/placement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <set>

#include "app/common.h"
#include "graph/iterate.h"

namespace knead::app {
namespace {

constexpr size_t kMostFrames = 60;

bool is(const PortType* type, const char* name) {
  return type && std::strcmp(type->name, name) == 0;
}
bool is_shape(const PortType* type) {
  return is(type, "Surface") || is(type, "Sdf");
}

// Per node: neither it nor what it stands on solves anything, which a tet mesh or a loop gives away.
std::vector<bool> placed_nodes(const Plan& plan) {
  std::vector<bool> placed(plan.nodes.size());
  for (size_t i = 0; i < plan.nodes.size(); ++i) {
    const PlanNode& node = plan.nodes[i];
    placed[i] = dynamic_cast<const Iterate*>(node.node.get()) == nullptr;
    for (const InputDeclaration& input : node.node->inputs()) placed[i] = placed[i] && !is(input.type, "TetMesh") && !is(input.type, "Points");
    for (const auto& port : node.inputs)
      for (const Source source : port) placed[i] = placed[i] && placed[static_cast<size_t>(source.node)];
  }
  return placed;
}

std::string name_of(const Plan& plan, Source source) {
  const PlanNode& node = plan.nodes[static_cast<size_t>(source.node)];
  return source.output == 0 ? node.name : node.name + "." + node.node->outputs()[static_cast<size_t>(source.output)].name;
}

// The outputs to look at, and the pairs that can meet: what a node takes as field and as surface, unless it makes another field or a file of them.
struct Interest {
  std::vector<Source> shapes;
  std::vector<std::pair<Source, Source>> pairs;  // body, collider
};

Interest interest_of(const Plan& plan) {
  const std::vector<bool> placed = placed_nodes(plan);
  Interest interest;
  for (size_t i = 0; i < plan.nodes.size(); ++i) {
    const PlanNode& node = plan.nodes[i];
    const auto& outputs = node.node->outputs();
    for (size_t k = 0; placed[i] && k < outputs.size(); ++k)
      if (is_shape(outputs[k].type)) interest.shapes.push_back({static_cast<int>(i), static_cast<int>(k)});
    if (node.node->has_effect() || (!outputs.empty() && is(outputs[0].type, "Sdf"))) continue;
    std::vector<Source> bodies, colliders;
    for (const auto& port : node.inputs)
      for (const Source source : port) {
        if (!placed[static_cast<size_t>(source.node)]) continue;
        if (is(plan.type_of(source), "Surface")) bodies.push_back(source);
        if (is(plan.type_of(source), "Sdf")) colliders.push_back(source);
      }
    for (const Source body : bodies)
      for (const Source collider : colliders)
        if (const std::pair pair{body, collider}; std::find(interest.pairs.begin(), interest.pairs.end(), pair) == interest.pairs.end())
          interest.pairs.push_back(pair);
  }
  return interest;
}

std::vector<int> spread(const std::vector<int>& frames) {
  if (frames.size() <= kMostFrames) return frames.empty() ? std::vector<int>{1} : frames;
  std::vector<int> some;
  for (size_t i = 0; i < kMostFrames; ++i) some.push_back(frames[i * (frames.size() - 1) / (kMostFrames - 1)]);
  return some;
}

void add_frame(Reach& reach, int frame, const Box& body, const Box& collider) {
  if (body.empty() || collider.empty()) return;
  const double gap = gap_between(body, collider);
  if (gap == 0) {
    reach.frames.push_back(frame);
    if (body.holds(collider) || collider.holds(body)) reach.enclosed.push_back(frame);
  } else if (gap < reach.nearest_gap) {
    reach.nearest_gap = gap;
    reach.nearest_frame = frame;
  }
}

std::string box_text(const Box& box) {
  if (box.empty()) return "empty";
  return fmt::format("({:.4g}, {:.4g}, {:.4g}) to ({:.4g}, {:.4g}, {:.4g}), diagonal {:.4g}", box.lower.x, box.lower.y, box.lower.z, box.upper.x,
                     box.upper.y, box.upper.z, box.diagonal());
}

}  // namespace

Placement find_placement(Evaluator& evaluator, const std::vector<int>& frames) {
  const Plan& plan = evaluator.plan();
  const Interest interest = interest_of(plan);
  const std::vector<int> looked_at = spread(frames);
  Placement placement;
  placement.frames_looked_at = looked_at.size();
  for (const auto& [body, collider] : interest.pairs) placement.reaches.push_back({name_of(plan, body), name_of(plan, collider), {}, {}});
  std::set<std::string> told;
  std::set<size_t> failed;
  for (const int frame : looked_at) {
    std::map<std::string, Box> boxes;
    for (size_t s = 0; s < interest.shapes.size(); ++s) {
      const Source source = interest.shapes[s];
      const std::string name = name_of(plan, source);
      const FrameResult result = evaluator.evaluate(frame, {name});
      for (const std::string& warning : result.warnings)
        if (told.insert(warning).second) placement.warnings.push_back(warning);
      if (result.error) {
        if (told.insert(result.error->what()).second) placement.errors.push_back(result.error->what());
        continue;
      }
      const bool moves = plan.nodes[static_cast<size_t>(source.node)].frame_dependent;
      const bool shown = frame == looked_at.front() || (moves && frame == looked_at.back());
      const Value& value = result.values.at(name);
      Shape shape{name, frame, box_of(value), shown ? contents_of(value) : std::string()};
      boxes[name] = shape.box;
      if (shown) placement.shapes.push_back(std::move(shape));
    }
    for (Reach& reach : placement.reaches) add_frame(reach, frame, boxes[reach.body], boxes[reach.collider]);
  }
  const auto by_name = [](const Shape& a, const Shape& b) { return a.name < b.name; };
  std::stable_sort(placement.shapes.begin(), placement.shapes.end(), by_name);
  return placement;
}

std::string placement_text(const Placement& placement, size_t frames) {
  std::string text;
  for (size_t i = 0; i < placement.shapes.size(); ++i) {
    const Shape& shape = placement.shapes[i];
    const bool follows = i > 0 && placement.shapes[i - 1].name == shape.name;
    const bool moves = follows || (i + 1 < placement.shapes.size() && placement.shapes[i + 1].name == shape.name);
    if (!follows) text += fmt::format("{}: {}\n", shape.name, shape.contents);
    text += fmt::format("  {}{}\n", moves ? fmt::format("frame {}: ", shape.frame) : "", box_text(shape.box));
  }
  for (const Reach& reach : placement.reaches) {
    text += fmt::format("{} can reach {} ", reach.collider, reach.body);
    if (reach.frames.empty())
      text += "at no frame";
    else if (reach.frames.size() == placement.frames_looked_at)
      text += placement.frames_looked_at == 1 ? fmt::format("at frame {}", reach.frames[0]) : "at every frame";
    else
      text += fmt::format("at frame{} {}", reach.frames.size() == 1 ? "" : "s", frames_text(reach.frames));
    if (reach.frames.empty() && std::isfinite(reach.nearest_gap))
      text += fmt::format(": {:.4g} apart at frame {}", reach.nearest_gap, reach.nearest_frame);
    if (!reach.enclosed.empty()) text += fmt::format("; one lies within the other's box at {}", frames_text(reach.enclosed));
    text += '\n';
  }
  if (placement.frames_looked_at < frames) text += fmt::format("looked at {} of {} frames\n", placement.frames_looked_at, frames);
  return text;
}

}  // namespace knead::app
