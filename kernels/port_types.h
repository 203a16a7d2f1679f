// The plain data that travels between Knead's nodes, as port types.
//
// Spaces. *World* is the user's own units, in double where it is composed. Every Surface and Sdf has a *local* space in which its float32 data is
// small and accurate, and a `placement` that takes local to world. H and everything inside the loop lives in *tet space*: local units of M divided by
// the finest octree cell, about the centre of M, along axes that M carries with it (kernels/surface/principal_frame.h), so that an offset of 1e6 or a
// scale of 1e-4 costs no precision, parameters are dimensionless, and a body that was turned before it was written gets the same H.
#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "graph/buffer.h"
#include "graph/report.h"
#include "graph/value.h"
#include "kernels/vec.h"

namespace knead {

class ExactDistance;

// x_world = scale * (rotation * x_local) + translation. rotation is row-major and orthonormal, scale > 0.
struct KNEAD_API Similarity {
  double scale = 1;
  std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};
  Vec3d translation{0, 0, 0};

  Vec3d rotate(const Vec3d& v) const {
    return {rotation[0] * v.x + rotation[1] * v.y + rotation[2] * v.z, rotation[3] * v.x + rotation[4] * v.y + rotation[5] * v.z,
            rotation[6] * v.x + rotation[7] * v.y + rotation[8] * v.z};
  }
  Vec3d apply(const Vec3d& local) const { return scale * rotate(local) + translation; }
  Similarity inverse() const;
  friend KNEAD_API Similarity operator*(const Similarity& outer, const Similarity& inner);  // (outer * inner).apply(x) == outer.apply(inner.apply(x))
  friend KNEAD_API bool operator==(const Similarity& a, const Similarity& b);
  bool is_identity() const { return *this == Similarity{}; }
};

// Polygons and what the file says about them. Host only, shared, immutable.
struct MeshTopology {
  std::vector<uint32_t> face_offsets;    // faces + 1 entries into face_vertices
  std::vector<uint32_t> face_vertices;   // corners
  std::vector<uint32_t> triangles;       // 3 per triangle: the polygons triangulated (concave ones too), orientation kept; degenerate ones left out
  std::vector<uint32_t> triangle_faces;  // the polygon each triangle came from

  size_t faces() const { return face_offsets.empty() ? 0 : face_offsets.size() - 1; }
  size_t corners() const { return face_vertices.size(); }
  size_t triangle_count() const { return triangles.size() / 3; }
};

// One number per vertex or per face that a program put into a PLY file for itself: quality, id, flags. Carried along, used for nothing.
struct MeshProperty {
  std::string name;
  std::string type;  // as PLY names it: "uchar", "float"
  std::vector<double> values;
};

// What survives the round trip beside points and polygons; empty vectors are absent. Host only, shared, immutable.
struct MeshAttributes {
  std::vector<std::array<float, 2>> texture_coordinates;  // pool
  std::vector<int32_t> corner_texture;                    // per corner, index into the pool or -1
  std::vector<Vec3f> normals;                             // pool; of the rest shape (writers recompute them once the surface has deformed)
  std::vector<int32_t> corner_normal;                     // per corner, or -1
  std::vector<std::array<float, 4>> vertex_colours;       // per vertex, 0 to 1, rgba
  std::vector<std::string> groups;                        // names
  std::vector<int32_t> face_group;                        // per face, index into groups or -1
  std::vector<std::string> materials;                     // names (OBJ usemtl)
  std::vector<int32_t> face_material;                     // per face, or -1
  std::string material_library;                           // OBJ mtllib
  std::vector<std::string> objects;                       // names (OBJ o)
  std::vector<int32_t> face_object;                       // per face, or -1
  std::vector<MeshProperty> vertex_properties;            // PLY's own
  std::vector<MeshProperty> face_properties;
  Key normals_of;  // Hasher over the bytes of the points that `normals` were made for; others: recompute
};

// M or a collider mesh.
struct Surface {
  Buffer<Vec3f> points;  // local space
  std::shared_ptr<const MeshTopology> topology;
  std::shared_ptr<const MeshAttributes> attributes;  // may be null
  Similarity placement;                              // local to world
  Vec3f lower{0, 0, 0}, upper{0, 0, 0};              // box of the rest shape's referenced, finite vertices, local space

  size_t vertices() const { return points.size(); }
  double diagonal() const { return length(to_double(upper) - to_double(lower)); }  // local units, of the rest shape
};

// A set of positions or vectors, one per vertex of M or of H; the port's doc says which, and in which space.
struct Points {
  Buffer<Vec3f> values;
};

// One float per vertex.
struct Weights {
  Buffer<float> values;
};

// Neighbours of every vertex, valence-sorted (paper Fig. 2). Lane t is vertex order[t]; lanes are sorted by valence, descending, within windows. Each
// block of kLaneBlock lanes lies by itself: the first neighbours of its lanes side by side, then the second ones, up to its largest valence.
// Neighbour k of lane t is entry block_offsets[t / kLaneBlock] + k * kLaneBlock + t % kLaneBlock. The paper has the k-th neighbours of all lanes side
// by side instead: the same entries, but a pass then reads as many streams as the largest valence, which a CPU cannot prefetch (docs/benchmarks.md).
// Places without a neighbour are entries whose contribution is exactly zero (`columns` index arrays of the lane's own vertex, or of vertex 0 in maps,
// `values` zero), so that a block of lanes needs no mask.
struct NeighbourTable {
  static constexpr uint32_t kLaneBlock = 16;
  uint32_t lanes = 0;              // vertices
  uint32_t largest = 0;            // valence
  uint32_t columns = 0;            // indices per neighbour: 3 for tets, 1 for edges and maps
  Buffer<uint32_t> order;          // [lanes padded to kLaneBlock] the vertex of a lane; padding lanes repeat the last vertex and must not be written
  Buffer<uint32_t> valence;        // [lanes padded] neighbours of a lane; 0 in padding lanes
  Buffer<uint32_t> block_offsets;  // [blocks + 1] first entry of each block, multiples of kLaneBlock
  Buffer<uint32_t> indices;        // [columns][entries], column c of entry e at c * entries + e
  Buffer<float> values;            // [entries] what goes with a neighbour: V0, L or w
  size_t entries() const { return values.size(); }
};

// H. Tet space.
struct TetMesh {
  Buffer<Vec3f> rest;                     // x_rest
  Buffer<std::array<uint32_t, 4>> tets;   // positively oriented: dot(cross(b - a, c - a), d - a) > 0 for (a, b, c, d)
  Buffer<float> rest_volumes;             // V0 > 0, per tet, cells^3
  Buffer<std::array<uint32_t, 2>> edges;  // a < b, sorted
  Buffer<float> rest_lengths;             // L, per edge, cells
  NeighbourTable vertex_tets;             // three other corners in an order that keeps the orientation (see restore_volume); values V0
  NeighbourTable vertex_strips;  // the same tets as strips, one new vertex per entry (kernels/build_tets/strips.h); values 1 / (6 V0), signed
  NeighbourTable vertex_edges;   // the other end; values L
  Buffer<float> lane_volumes;    // [lanes of vertex_tets, padded] the volume of the lane's tets, cells^3; 0 in padding lanes
  Similarity to_local;           // tet space to M's local space: scale is the finest cell's edge; vectors turn too
  float mean_edge = 0;           // mean of rest_lengths
  size_t vertices() const { return rest.size(); }
};

// W: M's vertices in H, both ways. Rows of `map` sum to 1.
struct Lattice {
  NeighbourTable map;      // lane: vertex of M; index: vertex of H; value w
  NeighbourTable gather;   // lane: vertex of H that M influences; index: vertex of M; value w_ij / sum_i w_ij
  Surface rest;            // M as it was bound
  Buffer<Vec3f> tet_rest;  // x_rest of H
  Similarity to_local;     // as TetMesh
};

// Signed distance to a collider, negative inside, as a NanoVDB float grid. Distances in the grid are in units of `local`.
struct Sdf {
  Buffer<std::byte> grid;                    // nanovdb::NanoGrid<float>, 32-byte aligned
  Similarity placement;                      // local to world
  Vec3f index_origin{0, 0, 0};               // local position of index (0, 0, 0); index = (local - index_origin) / voxel_size
  float voxel_size = 0;                      // local units
  float outside_band = 0, inside_depth = 0;  // local units: |distance| is exact to trilinear interpolation up to here on each side
  Vec3f lower{0, 0, 0}, upper{0, 0, 0};      // box of the surface, local space
  // The grid holds nothing outside this box, local space: what is there is not known to the field. Of a field that was built for one body (io/vdb/near_field.h).
  Vec3f known_lower{-kEverywhere, -kEverywhere, -kEverywhere}, known_upper{kEverywhere, kEverywhere, kEverywhere};
  std::shared_ptr<const Surface> mesh;  // the collider's triangles in the same local space, for exact projection; may be null
  // In the same space, to that mesh or to what the collider is instead; null: nothing exact is known, or whoever needs it makes it from the mesh
  // (kernels/surface/searchable_mesh.h).
  std::shared_ptr<const ExactDistance> distance;

  static constexpr float kEverywhere = 1e30f;
};

// How the last push went, where the loop's stopping rule reads it.
struct ContactProgress {
  double unrest = 0;                // deepest penetration met, or how far a collider still stands back, as a fraction of M's rest diagonal
  float deepest = 0;                // penetration, M's local units
  uint32_t inside = 0, pushed = 0;  // vertices in collision, and with a displacement that is not zero
  int32_t step = -1, steps = 0;     // of the colliders' way in; at `steps` they are in their places
};

// What collide_sdf remembers of each vertex of M between iterations.
struct Contacts {
  Buffer<float> memory;              // lambda >= 0 of method.md 3, local units of M; empty: all zero
  Buffer<ContactProgress> progress;  // one
  Buffer<Vec3f> stand_back;     // per collider: where it began, away from its place, M's local space (kernels/loop/approach.h); empty: in its place
  std::vector<Sdf> fields;      // the colliders as they have to be for this body (io/vdb/near_field.h); empty: as they are given
  Buffer<std::byte> colliders;  // as prepare_colliders (kernels/loop/collide.h) made them for the iterations to come; empty: not prepared
  Key colliders_of;             // what these two were made of
};

#define KNEAD_PORT_TYPE(T, ...)                                                        \
  template <>                                                                          \
  struct PortTraits<T> {                                                               \
    static constexpr const char* name = #T;                                            \
    template <class F>                                                                 \
    static void each_buffer([[maybe_unused]] T& v, [[maybe_unused]] F&& f) __VA_ARGS__ \
  };
template <class F>
void each_table_buffer(NeighbourTable& t, F&& f) {
  f(t.order);
  f(t.valence);
  f(t.block_offsets);
  f(t.indices);
  f(t.values);
}

template <>
struct KNEAD_API PortTraits<Surface> {
  static constexpr const char* name = "Surface";
  template <class F>
  static void each_buffer(Surface& v, F&& f) {
    f(v.points);
  }
  static Buffer<double> unrest(const Surface& before, const Surface& after,
                               Executor& executor);  // largest displacement of a vertex over the diagonal
};
template <>
struct KNEAD_API PortTraits<Contacts> {
  static constexpr const char* name = "Contacts";
  template <class F>
  static void each_buffer(Contacts& v, F&& f) {
    f(v.memory);
    f(v.progress);
    f(v.stand_back);
    f(v.colliders);
    for (Sdf& field : v.fields) f(field.grid);
  }
  static Buffer<double> unrest(const Contacts&, const Contacts& after, Executor&) { return after.progress.as<double>(); }
};
KNEAD_PORT_TYPE(Points, { f(v.values); })
KNEAD_PORT_TYPE(Weights, { f(v.values); })
KNEAD_PORT_TYPE(Sdf, { f(v.grid); })
template <>
struct KNEAD_API PortTraits<TetMesh> {
  static constexpr const char* name = "TetMesh";
  template <class F>
  static void each_buffer(TetMesh& v, F&& f) {
    f(v.rest);
    f(v.tets);
    f(v.rest_volumes);
    f(v.edges);
    f(v.rest_lengths);
    f(v.lane_volumes);
    each_table_buffer(v.vertex_tets, f);
    each_table_buffer(v.vertex_strips, f);
    each_table_buffer(v.vertex_edges, f);
  }
  // What the loop reads: less than half.
  template <class F>
  static void each_device_buffer(TetMesh& v, F&& f) {
    f(v.rest);
    f(v.lane_volumes);
    f(v.vertex_tets.order);
    each_table_buffer(v.vertex_strips, f);
    each_table_buffer(v.vertex_edges, f);
  }
};
KNEAD_PORT_TYPE(Lattice, {
  each_table_buffer(v.map, f);
  each_table_buffer(v.gather, f);
  f(v.rest.points);
  f(v.tet_rest);
})
#undef KNEAD_PORT_TYPE

}  // namespace knead
