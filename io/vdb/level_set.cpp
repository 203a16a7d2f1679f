// Which grid of a file is meant, and what has to be done to it before it can be sampled.
#include <openvdb/tools/ChangeBackground.h>
#include <openvdb/tools/SignedFloodFill.h>

#include <algorithm>
#include <limits>

#include "io/vdb/file_grids.h"

namespace knead::openvdb_side {
namespace {

using openvdb::Coord;
using openvdb::CoordBBox;
using openvdb::FloatGrid;

constexpr double kWidestBand = 12;    // voxels: more of a field's outside costs memory and says nothing
constexpr double kNarrowestBand = 2;  // voxels
constexpr int kTile = 4096;           // voxels along the largest tile: shifts by so many keep tiles whole

std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (size_t n = 0; n < names.size(); ++n) text += (n == 0 ? "" : n + 1 == names.size() ? " and " : ", ") + ("'" + names[n] + "'");
  return names.empty() ? "none" : text;
}

double voxel_of(const FloatGrid& grid) {
  return std::cbrt(std::abs(grid.voxelSize().product()));
}

std::string with_index(const std::string& name, size_t n) {
  return n == 0 ? name : fmt::format("{}[{}]", name, n);
}

FileGrid named(FileGrids& file, const std::string& path, const std::string& name, std::vector<std::string>& warnings) {
  std::vector<std::string> names;
  std::vector<FileGrid*> found;
  for (FileGrid& grid : file.grids) {
    names.push_back(grid.name);
    const std::string shared = grid.name.substr(0, grid.name.rfind('['));
    if (grid.name == name || (grid.name.ends_with(']') && shared == name)) found.push_back(&grid);
  }
  if (found.empty()) {
    const std::string near = nearest_name(name, names);
    fail(path, fmt::format("holds no grid '{}' (grids: {})", name, listed(names)), near.empty() ? std::string() : "did you mean '" + near + "'?");
  }
  if (found.size() > 1)
    warnings.push_back(
        fmt::format("the file holds {} grids called '{}'; the first is taken, '{}' names the next", found.size(), name, with_index(name, 1)));
  FileGrid chosen = *found[0];
  if (!chosen.grid) fail(path, fmt::format("grid '{}' {}", chosen.name, chosen.refusal), "a level set is a scalar grid: name another one with grid");
  if (chosen.grid->empty()) fail(path, "grid '" + chosen.name + "' is empty", "is the right grid named?");
  return chosen;
}

bool has_both_signs(const FloatGrid& grid) {
  bool above = false, below = false;
  for (auto value = grid.cbeginValueOn(); value && !(above && below); ++value) {
    above = above || *value > 0;
    below = below || *value < 0;
  }
  return above && below;
}

// Without a name: the first level set that holds something; where none is marked as one, the first grid that could be one.
FileGrid best(FileGrids& file, const std::string& path, std::vector<std::string>& warnings) {
  std::vector<FileGrid*> marked, others, signed_ones;
  std::vector<std::string> names, empty;
  for (FileGrid& grid : file.grids) {
    names.push_back(grid.name);
    if (grid.strange) warnings.push_back(fmt::format("grid '{}' {}; it is stepped over", grid.name, grid.refusal));
    if (!grid.grid) continue;
    if (grid.grid->empty()) {
      empty.push_back(grid.name);
      continue;
    }
    const auto kind = grid.grid->getGridClass();
    (kind == openvdb::GRID_LEVEL_SET ? marked : others).push_back(&grid);
    if (kind == openvdb::GRID_UNKNOWN && has_both_signs(*grid.grid)) signed_ones.push_back(&grid);
  }
  const std::vector<FileGrid*>& from = !marked.empty() ? marked : !signed_ones.empty() ? signed_ones : others;
  if (from.empty() && !empty.empty())
    fail(path,
         fmt::format("{} {} empty: there is no level set to be read (grids: {})", listed(empty), empty.size() == 1 ? "is" : "are", listed(names)));
  if (from.empty()) {
    std::string why;
    if (file.grids.size() == 1) why = fmt::format(": grid '{}' {}", file.grids[0].name, file.grids[0].refusal);
    fail(path, fmt::format("holds no scalar grid (grids: {}){}", listed(names), why), "a level set is a float grid");
  }
  if (!empty.empty()) warnings.push_back(fmt::format("{} {} empty and stepped over", listed(empty), empty.size() == 1 ? "is" : "are"));
  if (from.size() > 1 && &from != &others) {
    std::vector<std::string> rivals;
    for (const FileGrid* grid : from) rivals.push_back(grid->name);
    warnings.push_back(fmt::format("the file holds {} {}, {}; '{}' is taken, name one with grid", from.size(),
                                   &from == &marked ? "level sets" : "grids that could be level sets", listed(rivals), rivals[0]));
  }
  return *from[0];
}

struct Range {
  double least = std::numeric_limits<double>::infinity(), most = -least;
};

Range active_range(const FloatGrid& grid, const std::string& path) {
  Range range;
  for (auto value = grid.cbeginValueOn(); value; ++value) {
    if (!std::isfinite(*value)) fail(path, "grid '" + grid.getName() + "' holds values that are not finite", "write it again");
    range.least = std::min<double>(range.least, *value);
    range.most = std::max<double>(range.most, *value);
  }
  return range;
}

void check_signs(const FloatGrid& grid, const Range& range, const std::string& path) {
  const std::string name = "grid '" + grid.getName() + "'";
  switch (grid.getGridClass()) {
    case openvdb::GRID_FOG_VOLUME: fail(path, name + " is a fog volume (densities), not a level set", "convert it to a level set");
    case openvdb::GRID_STAGGERED: fail(path, name + " is a component of a staggered velocity, not a level set", "name another one with grid");
    default: break;
  }
  if (range.least < 0) {
    if (grid.background() < 0 && std::isfinite(grid.background()))
      fail(path, fmt::format("{} has the background {}: outside is negative, as if it were inside out", name, grid.background()),
           "a level set is negative inside; turn the sign of its values");
    return;
  }
  if (grid.background() == 0 && range.most <= 1)
    fail(path,
         fmt::format("{} holds values from {:.3g} to {:.3g} over a background of 0: densities of a fog volume, not distances", name, range.least,
                     range.most),
         "convert it to a level set");
  fail(path,
       fmt::format("{} has no surface: its values, from {:.3g} to {:.3g}, are nowhere negative. Distances without a sign have no inside", name,
                   range.least, range.most),
       "make signed distances, negative inside");
}

// Exact zeros on the surface count as background where that is 0, and are not active: active they become, between two that are.
void recover_zeros(FloatGrid& grid, const CoordBBox& box, bool dense) {
  auto accessor = grid.getAccessor();
  if (dense) {
    for (auto at = box.begin(); at; ++at)
      if (!accessor.isValueOn(*at)) accessor.setValueOn(*at, accessor.getValue(*at));
    return;
  }
  const auto active = [&](const Coord& c) { return accessor.isValueOn(c); };
  const double voxel = voxel_of(grid);
  const auto near = [&](const Coord& c) { return active(c) && std::abs(accessor.getValue(c)) < 1.5 * voxel; };
  for (int pass = 0; pass < 3; ++pass) {  // faces, edges, corners
    std::vector<Coord> zeros;
    for (auto value = grid.cbeginValueOn(); value; ++value)
      for (int axis = 0; axis < 3 && value.isVoxelValue(); ++axis) {
        Coord step(0, 0, 0);
        step[axis] = 1;
        const Coord next = value.getCoord() + step;
        if (!active(next) && near(value.getCoord()) && near(next + step) && accessor.getValue(next) == 0) zeros.push_back(next);
      }
    for (const Coord& c : zeros) accessor.setValueOn(c, 0.0f);
  }
}

// Least distance on the faces of the box that all values lie in.
double least_at_border(const FloatGrid& grid, const CoordBBox& box) {
  double least = std::numeric_limits<double>::infinity();
  for (auto value = grid.cbeginValueOn(); value; ++value) {
    const CoordBBox covers = value.getBoundingBox();
    for (int k = 0; k < 3; ++k)
      if (covers.min()[k] == box.min()[k] || covers.max()[k] == box.max()[k]) least = std::min<double>(least, *value);
  }
  return least;
}

// A background that is no band's width: distances in a full box, or a band that somebody filled with zeros.
void replace_background(FloatGrid& grid, const Range& range, std::vector<std::string>& warnings) {
  const std::string name = "grid '" + grid.getName() + "'";
  const double voxel = voxel_of(grid);
  const float before = grid.background();
  const CoordBBox box = grid.evalActiveVoxelBoundingBox();
  const Coord size = box.dim();
  const double volume = double(size.x()) * size.y() * size.z();
  const bool dense = static_cast<double>(grid.activeVoxelCount()) > 0.5 * volume;
  if (before == 0) recover_zeros(grid, box, dense);
  if (!dense) {
    const double band = std::clamp(std::max(range.most, -range.least), kNarrowestBand * voxel, kWidestBand * voxel);
    openvdb::tools::changeBackground(grid.tree(), static_cast<float>(band));
    openvdb::tools::signedFloodFillWithValues(grid.tree(), static_cast<float>(band), static_cast<float>(-band));
    warnings.push_back(
        fmt::format("{} has the background {}, which is no width of a band: taken as a level set with a band of {:.3g}, and what lies "
                    "beyond got the sign of the band beside it",
                    name, before, band));
    return;
  }
  const double border = least_at_border(grid, box);
  openvdb::tools::changeBackground(grid.tree(), static_cast<float>(std::clamp(border, kNarrowestBand * voxel, kWidestBand * voxel)));
  warnings.push_back(fmt::format("{} holds dense distances with background {}, taken as a level set", name, before));
  if (border < voxel)
    warnings.push_back(fmt::format("the surface of {} reaches the border of its voxels, where it is {:.3g} away; it is closed there", name, border));
}

// Float32 positions are good to a thousandth of a voxel up to some thousands of voxels, so voxels are numbered from near 0.
LevelSet numbered_from_near_zero(const FloatGrid::Ptr& grid) {
  LevelSet level_set;
  level_set.grid = grid;
  std::vector<int> at[3];
  for (auto leaf = grid->tree().cbeginLeaf(); leaf; ++leaf)
    for (int k = 0; k < 3; ++k) at[k].push_back(leaf->origin()[k]);
  Coord shift(0, 0, 0);
  for (int k = 0; k < 3 && !at[k].empty(); ++k) {  // the middle one: voxels that strayed far away have no say
    const auto middle = at[k].begin() + static_cast<ptrdiff_t>(at[k].size() / 2);
    std::nth_element(at[k].begin(), middle, at[k].end());
    shift[k] = static_cast<int>(std::lround(static_cast<double>(*middle) / kTile)) * kTile;
  }
  if (shift == Coord(0, 0, 0)) return level_set;
  auto shifted = FloatGrid::create(*grid);      // class, name, background; no voxels
  shifted->setTransform(grid->transformPtr());  // a copy of a transform would lose digits of its scale beside a large translation
  auto tile = grid->tree().cbeginValueAll();
  tile.setMaxDepth(decltype(tile)::LEAF_DEPTH - 1);
  for (; tile; ++tile)
    if (tile.isValueOn() || *tile != grid->background()) shifted->tree().addTile(tile.getLevel(), tile.getCoord() - shift, *tile, tile.isValueOn());
  for (auto leaf = grid->tree().cbeginLeaf(); leaf; ++leaf) {
    auto copy = std::make_unique<openvdb::FloatTree::LeafNodeType>(*leaf);
    copy->setOrigin(leaf->origin() - shift);
    shifted->tree().addLeaf(copy.release());
  }
  level_set.grid = shifted;
  level_set.shift = shift.asVec3d();
  return level_set;
}

}  // namespace

LevelSet choose_level_set(FileGrids file, const std::string& path, const std::string& name, std::vector<std::string>& warnings) {
  warnings.insert(warnings.end(), file.warnings.begin(), file.warnings.end());
  const FileGrid chosen = name.empty() ? best(file, path, warnings) : named(file, path, name, warnings);
  FloatGrid& grid = *chosen.grid;
  grid.setName(chosen.name);
  const Range range = active_range(grid, path);
  check_signs(grid, range, path);
  if (!(grid.background() > 0) || !std::isfinite(grid.background()))
    replace_background(grid, range, warnings);
  else if (grid.getGridClass() != openvdb::GRID_LEVEL_SET)
    warnings.push_back("grid '" + chosen.name + "' is not marked as a level set; it is taken for one");
  LevelSet level_set = numbered_from_near_zero(chosen.grid);
  const double voxel = voxel_of(grid);
  level_set.band = std::min({double{grid.background()}, std::max(range.most + voxel, kNarrowestBand * voxel), kWidestBand * voxel});
  return level_set;
}

}  // namespace knead::openvdb_side
