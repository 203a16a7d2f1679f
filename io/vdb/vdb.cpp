#include <fmt/format.h>
#include <nanovdb/util/GridHandle.h>
#include <nanovdb/util/IO.h>
#include <nanovdb/util/NanoToOpenVDB.h>
#include <nanovdb/util/OpenToNanoVDB.h>
#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <memory>
#include <optional>
#include <sstream>

#include "graph/cancel.h"
#include "graph/error.h"
#include "io/files.h"
#include "io/vdb/file_grids.h"
#include "io/vdb/vdb_module.h"
#include "kernels/surface/mesh_distance.h"

namespace knead {
namespace {

using openvdb::FloatGrid;
using openvdb_side::fail;
using openvdb_side::LevelSet;

bool ends_with(const std::string& path, const std::string& extension) {
  if (path.size() < extension.size()) return false;
  return std::equal(extension.rbegin(), extension.rend(), path.rbegin(),
                    [](char a, char b) { return a == std::tolower(static_cast<unsigned char>(b)); });
}

// The transform as a similarity of index space; index_origin and voxel_size take the scale.
Similarity placement_of(const FloatGrid& grid, const openvdb::Vec3d& shift, const std::string& path) {
  if (!grid.transform().isLinear()) fail(path, "grid '" + grid.getName() + "' has a frustum transform", "resample it with a uniform voxel size");
  // Where the axes go, seen from the grid's own place: the affine matrix of a map is less exact, the larger its translation.
  const openvdb::math::MapBase& map = *grid.transform().baseMap();
  const openvdb::Vec3d origin = map.applyMap(shift);
  Vec3d axis[3];
  for (int k = 0; k < 3; ++k) {
    openvdb::Vec3d one(0.0);
    one[k] = 1;
    const openvdb::Vec3d along = map.applyJacobian(one);
    axis[k] = {along.x(), along.y(), along.z()};
  }
  const double scale = std::cbrt(std::abs(dot(axis[0], cross(axis[1], axis[2]))));
  double off = 0;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) off = std::max(off, std::abs(dot(axis[a], axis[b]) / (scale * scale) - (a == b)));
  if (!(scale > 0) || !(off < 1e-4))
    fail(path,
         fmt::format("grid '{}' has voxels of {:.4g} x {:.4g} x {:.4g}, or a sheared transform", grid.getName(), length(axis[0]), length(axis[1]),
                     length(axis[2])),
         "resample it with cubic voxels; distances have no meaning otherwise");
  if (dot(axis[0], cross(axis[1], axis[2])) < 0)
    fail(path, "grid '" + grid.getName() + "' has a mirrored transform", "resample it without the mirror");
  Similarity placement;
  placement.scale = scale;
  for (int row = 0; row < 3; ++row)
    for (int k = 0; k < 3; ++k) placement.rotation[3 * row + k] = axis[k][row] / scale;
  placement.translation = {origin.x(), origin.y(), origin.z()};
  return placement;
}

// The grid's own surface in index space, for distances that its narrow band does not hold.
std::unique_ptr<MeshDistance> surface_of(const FloatGrid& grid, Executor& executor) {
  const auto transform = openvdb::math::Transform::createLinearTransform(1.0);
  std::vector<openvdb::Vec3s> points;
  std::vector<openvdb::Vec4I> quads;
  FloatGrid plain(grid);  // shares the tree
  plain.setTransform(transform);
  openvdb::tools::volumeToMesh(plain, points, quads, 0.0);
  check_cancelled();
  if (quads.empty()) return nullptr;
  std::vector<Vec3f> positions;
  std::vector<uint32_t> triangles;
  for (const openvdb::Vec3s& p : points) positions.push_back({p.x(), p.y(), p.z()});
  for (const openvdb::Vec4I& q : quads)  // OpenVDB's faces turn the other way round
    for (int corner : {0, 2, 1, 0, 3, 2}) triangles.push_back(q[corner]);
  return std::make_unique<MeshDistance>(std::span<const Vec3f>(positions), triangles, &executor);
}

ReadSdf complete(const LevelSet& level_set, ReadSdf result, const std::string& path, Executor& executor, uint64_t memory_limit) {
  const FloatGrid& grid = *level_set.grid;
  const std::string name = "grid '" + grid.getName() + "'";
  const Similarity placement = placement_of(grid, level_set.shift, path);
  const std::unique_ptr<MeshDistance> surface = surface_of(grid, executor);
  if (!surface) fail(path, name + " has no surface: no neighbouring voxels have different signs", "is it a level set, negative inside?");

  // A distance changes by one voxel size from voxel to voxel; a file in other units, or one that is no distance, shows in its slope across the surface.
  double slope = 0;
  size_t slopes = 0;
  auto accessor = grid.getConstAccessor();
  for (auto value = grid.cbeginValueOn(); value; ++value) {
    if (!value.isVoxelValue() || std::abs(*value) > 0.75 * placement.scale || ++slopes % 7 != 0) continue;
    const openvdb::Coord c = value.getCoord();
    const double x = accessor.getValue(c.offsetBy(1, 0, 0)) - accessor.getValue(c.offsetBy(-1, 0, 0));
    const double y = accessor.getValue(c.offsetBy(0, 1, 0)) - accessor.getValue(c.offsetBy(0, -1, 0));
    const double z = accessor.getValue(c.offsetBy(0, 0, 1)) - accessor.getValue(c.offsetBy(0, 0, -1));
    slope += std::sqrt(x * x + y * y + z * z) / (2 * placement.scale);
  }
  check_cancelled();
  slope /= std::max<size_t>(1, slopes / 7);
  if (slopes / 7 > 0 && (slope < 0.7 || slope > 1.4))
    result.warnings.push_back(
        fmt::format("{} changes by {:.3g} per unit of length across its surface; a distance changes by 1. Is it in other units than its transform?",
                    name, slope));

  const double to_index = 1 / placement.scale;
  SdfPlan plan;
  plan.voxel_size = 1;  // local space is index space; the placement holds the rest
  plan.lower = surface->lower();
  plan.upper = surface->upper();
  plan.band = level_set.band * to_index;
  plan.memory_limit = memory_limit;
  plan.true_distances = false;
  result.sdf = openvdb_side::build_sdf(executor, plan, [&](const Vec3d& local, uint32_t& hint) {
    const openvdb::Coord ijk(static_cast<int>(std::lround(local.x)), static_cast<int>(std::lround(local.y)), static_cast<int>(std::lround(local.z)));
    float value = 0;
    const bool active = grid.tree().probeValue(ijk, value);
    const bool is_tile = value < 0 && grid.tree().getValueDepth(ijk) < static_cast<int>(openvdb::FloatTree::DEPTH) - 1;  // one value for many places
    if (value > 0 || (active && !is_tile)) return value * to_index;
    return -std::abs(surface->signed_distance_near(local, hint).distance);
  });
  result.sdf.placement = placement;
  return result;
}

}  // namespace

namespace openvdb_side {

ReadSdf read_sdf(const std::string& path, const std::string& name, Executor& executor, uint64_t memory_limit) {
  openvdb::initialize();
  const bool open = ends_with(path, ".vdb");
  if (!open && !ends_with(path, ".nvdb")) fail(path, "the name must end in .vdb or .nvdb", "level sets are read from OpenVDB and NanoVDB files");
  ReadSdf result;
  const LevelSet level_set = choose_level_set(open ? read_openvdb_file(path) : read_nanovdb_file(path), path, name, result.warnings);
  return complete(level_set, std::move(result), path, executor, memory_limit);
}

void write_sdf(const std::string& path, const Sdf& sdf, const std::string& name) {
  const bool nano = ends_with(path, ".nvdb");
  if (!nano && !ends_with(path, ".vdb")) fail(path, "the name must end in .vdb or .nvdb", "the extension chooses the format");
  openvdb::initialize();
  const auto* blob = reinterpret_cast<const nanovdb::NanoGrid<float>*>(sdf.grid.host().data());
  FloatGrid::Ptr grid = openvdb::gridPtrCast<FloatGrid>(nanovdb::nanoToOpenVDB(*blob));
  const float scale = static_cast<float>(sdf.placement.scale);
  if (scale != 1.0f) {
    grid->tree().root().setBackground(grid->background() * scale, true);
    for (auto value = grid->beginValueOn(); value; ++value) value.setValue(*value * scale);
  }
  const Vec3d origin = sdf.placement.apply(to_double(sdf.index_origin));
  const double voxel = sdf.placement.scale * sdf.voxel_size;
  openvdb::math::Mat4d m = openvdb::math::Mat4d::identity();
  for (int row = 0; row < 3; ++row) {
    for (int k = 0; k < 3; ++k) m(k, row) = sdf.placement.rotation[3 * row + k] * voxel;
    m(3, row) = origin[row];
  }
  try {
    const bool turned = sdf.placement.rotation != Similarity{}.rotation;
    auto transform = openvdb::math::Transform::createLinearTransform(turned ? 1.0 : voxel);
    transform->postTranslate({origin.x, origin.y, origin.z});
    grid->setTransform(turned ? openvdb::math::Transform::createLinearTransform(m) : transform);
  } catch (const openvdb::Exception&) {
    fail(path, fmt::format("OpenVDB cannot hold voxels as small as {:.3g}", voxel),
         "write the scene in smaller units, so that a voxel is above 1e-4");
  }
  grid->setName(name);
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  if (nano) {
    const auto handle = nanovdb::openToNanoVDB(*grid);
    std::ostringstream bytes(std::string(handle.size() + 4096, '\0'));  // NanoVDB's writer skips ahead and comes back for its header
    nanovdb::io::writeGrid(bytes, handle);
    const std::string written = bytes.str();
    return write_whole_file(path, std::string_view(written).substr(0, static_cast<size_t>(bytes.tellp())));
  }
  std::ostringstream bytes;
  openvdb::io::Stream(bytes).write({grid});
  write_whole_file(path, bytes.str());
}

}  // namespace openvdb_side

extern "C" const VdbFunctions* knead_vdb_functions() {
  static constexpr VdbFunctions functions{openvdb_side::build_sdf, openvdb_side::estimate_sdf_bytes, openvdb_side::read_sdf, openvdb_side::write_sdf};
  return &functions;
}

}  // namespace knead
