// GridValidator.h writes to std::cerr without including <iostream>.
// clang-format off
#include <iostream>
#include <nanovdb/util/GridValidator.h>
// clang-format on

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
#include <iostream>  // NanoVDB's validator needs it and does not say so
#include <memory>
#include <optional>
#include <sstream>

#include "graph/error.h"
#include "io/files.h"
#include "io/vdb/vdb_module.h"
#include "kernels/surface/mesh_distance.h"

namespace knead {
namespace {

using openvdb::FloatGrid;

bool ends_with(const std::string& path, const std::string& extension) {
  if (path.size() < extension.size()) return false;
  return std::equal(extension.rbegin(), extension.rend(), path.rbegin(),
                    [](char a, char b) { return a == std::tolower(static_cast<unsigned char>(b)); });
}

[[noreturn]] void fail(const std::string& path, const std::string& message, const std::string& hint = {}) {
  throw Error(ErrorCode::kFile, in_file(path), message, hint);
}

std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + ("'" + name + "'");
  return text.empty() ? "none" : text;
}

FloatGrid::Ptr as_float(const openvdb::GridBase::Ptr& grid) {
  if (auto same = openvdb::gridPtrCast<FloatGrid>(grid)) return same;
  if (auto wide = openvdb::gridPtrCast<openvdb::DoubleGrid>(grid)) return std::make_shared<FloatGrid>(*wide);
  return nullptr;
}

FloatGrid::Ptr read_vdb(const std::string& path, const std::string& name) {
  std::istringstream bytes(read_whole_file(path));
  std::vector<std::string> names;
  try {
    openvdb::io::Stream stream(bytes, false);
    const openvdb::GridPtrVecPtr grids = stream.getGrids();
    for (const bool any_class : {false, true})
      for (const openvdb::GridBase::Ptr& grid : *grids) {
        if (!any_class) names.push_back(grid->getName());
        const bool wanted = name.empty() ? any_class || grid->getGridClass() == openvdb::GRID_LEVEL_SET : grid->getName() == name;
        if (!wanted) continue;
        if (FloatGrid::Ptr found = as_float(grid)) return found;
        if (!name.empty())
          fail(path, fmt::format("grid '{}' holds {}, not float or double", name, grid->valueType()), "a level set is a scalar grid");
      }
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    fail(path, std::string("not a readable .vdb file: ") + e.what(), "write it again; OpenVDB 10 and older files are understood");
  }
  if (name.empty()) fail(path, "holds no scalar grid (grids: " + listed(names) + ")", "a level set is a float grid");
  const std::string near = nearest_name(name, names);
  fail(path, fmt::format("holds no grid '{}' (grids: {})", name, listed(names)), near.empty() ? std::string() : "did you mean '" + near + "'?");
}

FloatGrid::Ptr read_nvdb(const std::string& path, const std::string& name) {
  std::istringstream bytes(read_whole_file(path));
  std::vector<std::string> names;
  try {
    for (const auto& handle : nanovdb::io::readGrids<nanovdb::HostBuffer, std::vector>(bytes)) {
      if (!handle) continue;
      names.push_back(handle.gridMetaData()->shortGridName());
      if (!name.empty() && names.back() != name) continue;
      const auto* grid = handle.template grid<float>();
      if (!grid && !name.empty()) fail(path, fmt::format("grid '{}' is not a float grid", name), "a level set is a scalar grid");
      if (!grid) continue;
      if (!nanovdb::isValid(*grid, true, false))
        fail(path, fmt::format("grid '{}' is damaged (its checksum or its structure is wrong)", names.back()), "write it again");
      return openvdb::gridPtrCast<FloatGrid>(nanovdb::nanoToOpenVDB(*grid));
    }
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    fail(path, std::string("not a readable .nvdb file: ") + e.what(),
         "Knead reads uncompressed NanoVDB 32 files; write it again without compression");
  }
  const std::string near = nearest_name(name, names);
  fail(path, fmt::format("holds no float grid{} (grids: {})", name.empty() ? "" : " '" + name + "'", listed(names)),
       near.empty() ? "" : "did you mean '" + near + "'?");
}

// The transform as a similarity of index space; index_origin and voxel_size take the scale.
Similarity placement_of(const FloatGrid& grid, const std::string& path) {
  if (!grid.transform().isLinear()) fail(path, "grid '" + grid.getName() + "' has a frustum transform", "resample it with a uniform voxel size");
  const openvdb::math::Mat4d m = grid.transform().baseMap()->getAffineMap()->getMat4();  // row vectors: row k is where axis k goes
  Vec3d axis[3];
  for (int k = 0; k < 3; ++k) axis[k] = {m(k, 0), m(k, 1), m(k, 2)};
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
  placement.translation = {m(3, 0), m(3, 1), m(3, 2)};
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
  if (quads.empty()) return nullptr;
  std::vector<Vec3f> positions;
  std::vector<uint32_t> triangles;
  for (const openvdb::Vec3s& p : points) positions.push_back({p.x(), p.y(), p.z()});
  for (const openvdb::Vec4I& q : quads)  // OpenVDB's faces turn the other way round
    for (int corner : {0, 2, 1, 0, 3, 2}) triangles.push_back(q[corner]);
  return std::make_unique<MeshDistance>(std::span<const Vec3f>(positions), triangles, &executor);
}

ReadSdf complete(FloatGrid& grid, const std::string& path, Executor& executor, uint64_t memory_limit) {
  ReadSdf result;
  const std::string name = "grid '" + grid.getName() + "'";
  const Similarity placement = placement_of(grid, path);
  const double background = grid.background();
  if (grid.getGridClass() == openvdb::GRID_FOG_VOLUME)
    fail(path, name + " is a fog volume (densities), not a level set", "convert it to a level set");
  if (!(background > 0) || !std::isfinite(background))
    fail(path, fmt::format("{} has the background {}; a level set's is the positive width of its band", name, background),
         "convert it to a level set");
  if (grid.getGridClass() != openvdb::GRID_LEVEL_SET) result.warnings.push_back(name + " is not marked as a level set; it is taken for one");

  float deepest = 0;
  bool bad = false;
  for (auto value = grid.cbeginValueOn(); value; ++value) {
    bad = bad || !std::isfinite(*value);
    deepest = std::min(deepest, *value);
  }
  if (bad) fail(path, name + " holds values that are not finite", "write it again");
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
  plan.band = background * to_index;
  plan.memory_limit = memory_limit;
  plan.true_distances = false;
  const FloatGrid& source = grid;
  result.sdf = openvdb_side::build_sdf(executor, plan, [&](const Vec3d& local, uint32_t& hint) {
    const openvdb::Coord ijk(static_cast<int>(std::lround(local.x)), static_cast<int>(std::lround(local.y)), static_cast<int>(std::lround(local.z)));
    float value = 0;
    if (source.tree().probeValue(ijk, value) || value > 0) return value * to_index;
    return -std::abs(surface->signed_distance_near(local, hint).distance);
  });
  result.sdf.placement = placement;
  return result;
}

}  // namespace

namespace openvdb_side {

ReadSdf read_sdf(const std::string& path, const std::string& name, Executor& executor, uint64_t memory_limit) {
  openvdb::initialize();
  FloatGrid::Ptr grid;
  if (ends_with(path, ".vdb")) grid = read_vdb(path, name);
  if (ends_with(path, ".nvdb")) grid = read_nvdb(path, name);
  if (!grid) fail(path, "the name must end in .vdb or .nvdb", "level sets are read from OpenVDB and NanoVDB files");
  if (grid->empty()) fail(path, "grid '" + grid->getName() + "' is empty", "is the right grid named?");
  return complete(*grid, path, executor, memory_limit);
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
