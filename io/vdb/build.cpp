#include <fmt/format.h>
#include <nanovdb/util/OpenToNanoVDB.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <atomic>
#include <cstring>

#include "graph/cancel.h"
#include "graph/error.h"
#include "io/vdb/vdb_module.h"

namespace knead {
namespace {

using Leaf = openvdb::FloatTree::LeafNodeType;

constexpr int kSide = 8;                          // voxels along a leaf
constexpr double kLeafReach = 6.07;               // from a leaf's middle to its furthest voxel: 3.5 sqrt(3)
constexpr double kFineDepth = 6;                  // voxels: leaves that are deeper all over are sampled coarsely
constexpr double kCoarseTolerance = 0.3;          // voxels
constexpr uint64_t kLeafBytes = 2 * 2300 + 2200;  // a leaf in OpenVDB, in NanoVDB, and in the copy that leaves here
constexpr double kTrilinearReach = 1.75;          // voxels: a trilinear sample looks sqrt(3) further than its own position

struct Candidate {
  int x, y, z;  // index of its first voxel
  bool deep;
  double distance;  // at its middle, voxels
  uint32_t hint;
};

class Builder {
 public:
  Builder(Executor& executor, const SdfPlan& plan, DistanceAt distance) : executor_(executor), plan_(plan), distance_(distance) {}

  // The leaves that hold something, or as many of them as `most` allows.
  std::vector<Candidate> find_leaves(size_t most) const;
  Sdf build();

 private:
  double at(double i, double j, double k, uint32_t& hint) const {
    const double h = plan_.voxel_size;
    return distance_(plan_.origin + h * Vec3d{i, j, k}, hint) / h;
  }
  std::array<int, 6> leaf_box() const { return leaf_box(plan_.lower, plan_.upper, (plan_.band + 1) * plan_.voxel_size); }
  std::array<int, 6> leaf_box(const Vec3d& lower, const Vec3d& upper, double margin) const;
  std::vector<Candidate> leaves_of_boxes(size_t most) const;
  void sample_fine(const Candidate& candidate, Leaf& leaf) const;
  void sample_deep(const Candidate& candidate, Leaf& leaf) const;
  void store(Leaf& leaf, int n, double value) const {
    const bool active = value < plan_.band;
    leaf.buffer().setValue(static_cast<openvdb::Index>(n), static_cast<float>((active ? value : plan_.band) * plan_.voxel_size));
    if (active) leaf.setActiveState(static_cast<openvdb::Index>(n), true);
  }

  Executor& executor_;
  const SdfPlan& plan_;
  DistanceAt distance_;
};

// First and one-past-last leaf along each axis.
std::array<int, 6> Builder::leaf_box(const Vec3d& from, const Vec3d& to, double margin) const {
  std::array<int, 6> box;
  for (int k = 0; k < 3; ++k) {
    double lower = from[k] - margin, upper = to[k] + margin;
    if (plan_.only) lower = std::max(lower, (*plan_.only)[0][k]), upper = std::min(upper, (*plan_.only)[1][k]);
    upper = std::max(lower, upper);  // where the two boxes do not meet there is nothing to build
    box[k] = static_cast<int>(std::floor((lower - plan_.origin[k]) / plan_.voxel_size / kSide));
    box[3 + k] = static_cast<int>(std::floor((upper - plan_.origin[k]) / plan_.voxel_size / kSide)) + 1;
  }
  return box;
}

// The leaves of all boxes, each once; no more than twice as many as `most`.
std::vector<Candidate> Builder::leaves_of_boxes(size_t most) const {
  std::vector<std::array<int, 3>> places;
  const auto add = [&](const std::array<int, 6>& box) {
    for (int x = box[0]; x < box[3]; ++x)
      for (int y = box[1]; y < box[4]; ++y) {
        check_cancelled();
        for (int z = box[2]; z < box[5]; ++z) {
          if (places.size() > 2 * most) return;
          places.push_back({x, y, z});
        }
      }
  };
  if (plan_.boxes.empty()) add(leaf_box());
  for (const auto& [lower, upper] : plan_.boxes) add(leaf_box(lower, upper, 0));
  std::sort(places.begin(), places.end());
  places.erase(std::unique(places.begin(), places.end()), places.end());
  std::vector<Candidate> found;
  for (const auto& [x, y, z] : places) found.push_back({x * kSide, y * kSide, z * kSide, false, 0, ~0u});
  return found;
}

std::vector<Candidate> Builder::find_leaves(size_t most) const {
  if (!plan_.true_distances) return leaves_of_boxes(most);
  const std::array<int, 6> box = leaf_box();
  std::vector<Candidate> found;
  // Cubes of leaves, halved level by level; what is far outside falls away early. Breadth first, so that a level's tests run at once.
  struct Cube {
    int x, y, z;  // leaves
    double distance;
    uint32_t hint;
  };
  int size = 1;
  while (size < std::max({box[3] - box[0], box[4] - box[1], box[5] - box[2]})) size *= 2;
  std::vector<Cube> level{{box[0], box[1], box[2], 0, ~0u}}, next;
  for (;; size /= 2) {
    if (level.size() > most) break;
    const double middle = 0.5 * (size * kSide - 1), reach = middle * std::sqrt(3.0) + 0.01;
    executor_.parallel_ranges(level.size(), 64, [&](size_t begin, size_t end) {
      for (size_t n = begin; n < end; ++n)
        level[n].distance = at(level[n].x * kSide + middle, level[n].y * kSide + middle, level[n].z * kSide + middle, level[n].hint);
    });
    next.clear();
    for (const Cube& cube : level) {
      if (cube.distance > plan_.band + reach) continue;
      if (size == 1) {
        found.push_back({cube.x * kSide, cube.y * kSide, cube.z * kSide, cube.distance < -(kFineDepth + kLeafReach), cube.distance, cube.hint});
        continue;
      }
      for (int n = 0; n < 8; ++n) {
        const int half = size / 2;
        const Cube part{cube.x + (n >> 2) * half, cube.y + (n >> 1 & 1) * half, cube.z + (n & 1) * half, 0, cube.hint};
        if (part.x < box[3] && part.y < box[4] && part.z < box[5]) next.push_back(part);
      }
    }
    if (size == 1) return found;
    level.swap(next);
  }
  found.resize(level.size());
  return found;
}

void Builder::sample_fine(const Candidate& candidate, Leaf& leaf) const {
  uint32_t hint = candidate.hint, hint_y = hint, hint_z = hint;  // from the neighbour before, whichever axis that is along
  int n = 0;
  for (int i = 0; i < kSide; ++i)
    for (int j = 0; j < kSide; ++j) {
      hint = j == 0 ? hint_y : hint_z;
      double below = 0;  // distances change by no more than a voxel per step: far outside a reason not to search
      for (int k = 0; k < kSide; ++k, ++n) {
        double value = below - 1;
        if (value <= plan_.band || !plan_.true_distances) value = at(candidate.x + i, candidate.y + j, candidate.z + k, hint);
        below = value;
        store(leaf, n, value);
        if (k == 0) hint_z = hint;
        if (k == 0 && j == 0) hint_y = hint;
      }
    }
}

void Builder::sample_deep(const Candidate& candidate, Leaf& leaf) const {
  double lattice[3][3][3];
  uint32_t hint = candidate.hint;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k) lattice[i][j][k] = at(candidate.x + 4 * i, candidate.y + 4 * j, candidate.z + 4 * k, hint);
  auto interpolate = [&](double x, double y, double z) {
    const int i = x >= 4, j = y >= 4, k = z >= 4;
    const double u = x / 4 - i, v = y / 4 - j, w = z / 4 - k;
    double sum = 0;
    for (int n = 0; n < 8; ++n) {
      const int a = n >> 2, b = n >> 1 & 1, c = n & 1;
      sum += (a ? u : 1 - u) * (b ? v : 1 - v) * (c ? w : 1 - w) * lattice[i + a][j + b][k + c];
    }
    return sum;
  };
  for (int n = 0; n < 8; ++n) {  // the middles between, where a medial surface shows
    const double x = 2 + 4 * (n >> 2), y = 2 + 4 * (n >> 1 & 1), z = 2 + 4 * (n & 1);
    if (std::abs(at(candidate.x + x, candidate.y + y, candidate.z + z, hint) - interpolate(x, y, z)) > kCoarseTolerance)
      return sample_fine(candidate, leaf);
  }
  for (int n = 0; n < kSide * kSide * kSide; ++n) store(leaf, n, interpolate(n >> 6, n >> 3 & 7, n & 7));
}

std::string in_mib(double bytes) {
  return fmt::format("{:.0f} MiB", std::ceil(bytes / (1 << 20)));
}

double longest_side(const SdfPlan& plan) {
  const Vec3d size = plan.only ? (*plan.only)[1] - (*plan.only)[0] : plan.upper - plan.lower;
  return std::max({size.x, size.y, size.z});
}

// Throws when the plan cannot fit, before anything large is allocated.
void check_memory(Executor& executor, const SdfPlan& plan, DistanceAt distance) {
  if (!plan.true_distances) return;  // such grids are copies of something that fits; Builder::build counts as it goes
  const double estimate = static_cast<double>(openvdb_side::estimate_sdf_bytes(executor, plan, distance));
  if (estimate <= static_cast<double>(plan.memory_limit)) return;
  double fits = plan.voxel_size * std::sqrt(estimate / static_cast<double>(plan.memory_limit));  // too fine where volume, not area, counts
  for (int tries = 0; tries < 40; ++tries, fits *= 1.1) {
    SdfPlan coarser = plan;
    coarser.voxel_size = fits;
    if (openvdb_side::estimate_sdf_bytes(executor, coarser, distance) <= plan.memory_limit) break;
  }
  throw Error(ErrorCode::kMemory,
              fmt::format("a signed distance field with voxels of {:.4g} would take about {} to build, more than the limit of {}",
                          plan.voxel_size * plan.world_scale, in_mib(estimate), in_mib(static_cast<double>(plan.memory_limit))),
              fmt::format("a voxel size of {:.3g} fits; or raise memory_limit", fits * plan.world_scale));
}

Sdf Builder::build() {
  const size_t most = plan_.true_distances ? std::numeric_limits<size_t>::max() : 64 * (plan_.memory_limit / kLeafBytes);
  const std::vector<Candidate> candidates = find_leaves(most);
  std::vector<std::unique_ptr<Leaf>> leaves(candidates.size());
  std::vector<float> deepest(candidates.size(), 0.0f);
  std::atomic<uint64_t> kept{0};
  if (candidates.size() > most) kept = plan_.memory_limit;
  executor_.parallel_ranges(candidates.size(), 1, [&](size_t begin, size_t end) {
    for (size_t n = begin; n < end; ++n) {
      if (kept.load(std::memory_order_relaxed) * kLeafBytes > plan_.memory_limit) return;
      const Candidate& c = candidates[n];
      if (plan_.check_cancelled) plan_.check_cancelled();
      auto leaf = std::make_unique<Leaf>(openvdb::Coord(c.x, c.y, c.z), static_cast<float>(plan_.band * plan_.voxel_size), false);
      if (c.deep) {
        sample_deep(c, *leaf);
      } else {
        sample_fine(c, *leaf);
      }
      if (leaf->isEmpty()) continue;
      for (auto value = leaf->cbeginValueOn(); value; ++value) deepest[n] = std::max(deepest[n], -*value);
      leaves[n] = std::move(leaf);
      kept.fetch_add(1, std::memory_order_relaxed);
    }
  });
  if (kept.load() * kLeafBytes > plan_.memory_limit)
    throw Error(ErrorCode::kMemory,
                fmt::format("a signed distance field with voxels of {:.4g} takes more than the limit of {}", plan_.voxel_size * plan_.world_scale,
                            in_mib(static_cast<double>(plan_.memory_limit))),
                "take a larger voxel size, or raise memory_limit");

  auto grid = openvdb::FloatGrid::create(static_cast<float>(plan_.band * plan_.voxel_size));
  for (auto& leaf : leaves)
    if (leaf) grid->tree().addLeaf(leaf.release());
  check_cancelled();
  grid->setName("surface");
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(1.0));  // Sdf holds the place; OpenVDB refuses voxels below 1e-5
  const auto handle = nanovdb::openToNanoVDB(*grid);
  grid.reset();

  Sdf sdf;
  sdf.grid = Buffer<std::byte>(handle.size());
  std::memcpy(sdf.grid.data_for_write(), handle.data(), handle.size());
  sdf.index_origin = to_float(plan_.origin);
  sdf.voxel_size = static_cast<float>(plan_.voxel_size);
  sdf.outside_band = static_cast<float>(std::max(0.0, plan_.band - kTrilinearReach) * plan_.voxel_size);
  for (float depth : deepest) sdf.inside_depth = std::max(sdf.inside_depth, depth);
  sdf.lower = to_float(plan_.lower);
  sdf.upper = to_float(plan_.upper);
  return sdf;
}

}  // namespace

namespace openvdb_side {

uint64_t estimate_sdf_bytes(Executor& executor, const SdfPlan& plan, DistanceAt distance) {
  // A classification that costs a few thousand queries at most; finer voxels scale as the volume they fill.
  constexpr size_t kMostLeaves = 20000;
  SdfPlan coarse = plan;
  coarse.voxel_size = std::max(plan.voxel_size, longest_side(plan) / 512);
  for (;; coarse.voxel_size *= 1.5) {
    const size_t leaves = Builder(executor, coarse, distance).find_leaves(kMostLeaves).size();
    if (leaves > kMostLeaves) continue;
    const double ratio = coarse.voxel_size / plan.voxel_size;
    return static_cast<uint64_t>(std::min(9e18, static_cast<double>(leaves * kLeafBytes) * ratio * ratio * ratio));
  }
}

Sdf build_sdf(Executor& executor, const SdfPlan& plan, DistanceAt distance) {
  if (!(plan.voxel_size > 0) || !std::isfinite(plan.voxel_size))
    throw Error(ErrorCode::kInput, "the voxel size of a signed distance field must be positive");
  if (!(longest_side(plan) / plan.voxel_size < 1e9)) {
    throw Error(ErrorCode::kMemory,
                fmt::format("{:.3g} voxels along the longest side cannot be numbered, let alone held", longest_side(plan) / plan.voxel_size),
                fmt::format("voxel size {:.3g} gives 256 along the longest side", longest_side(plan) * plan.world_scale / 256));
  }
  check_memory(executor, plan, distance);
  openvdb::initialize();
  return Builder(executor, plan, distance).build();
}

}  // namespace openvdb_side

}  // namespace knead
