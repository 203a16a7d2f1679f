// The paper's loop as one would write it down first: adjacency in vectors of vectors, double, Eigen for the 3x3 least squares, a dense grid of
// distances, one thread, no layout. The formulas are the kernels' own (restore_volume.h, enforce_stiffness.h, lattice_map.h, method of collide_sdf),
// so that results agree.
#pragma once
#include <Eigen/Core>
#include <array>
#include <utility>
#include <vector>

#include "kernels/port_types.h"

namespace knead::bench {

// Distances on a grid, in world units; a large one outside.
struct PlainField {
  Eigen::Matrix3d to_grid;  // a place of the grid: to_grid * p + offset, in voxels
  Eigen::Vector3d offset;
  double voxel = 0;  // world units
  std::array<int, 3> size{};
  std::vector<double> values;

  explicit PlainField(const Sdf& sdf);
  double value(const Eigen::Vector3d& p) const;
  Eigen::Vector3d gradient(const Eigen::Vector3d& p) const;
};

class PlainLoop {
 public:
  PlainLoop(const TetMesh& tets, const Lattice& lattice);

  void place(const Buffer<Vec3f>& points);  // H, tet space
  void collide(const std::vector<PlainField>& colliders);
  void map_to_tets(double max_step);
  void restore_volume(double relaxation, double regularisation, double max_step);
  void enforce_stiffness(double stiffness, double max_step);
  void map_to_surface();

  const std::vector<Eigen::Vector3d>& points() const { return x_; }
  const std::vector<Eigen::Vector3d>& surface() const { return y_; }
  const std::vector<Eigen::Vector3d>& pushes() const { return displacement_; }

 private:
  struct Weighted {
    int index;
    double weight;
  };
  std::vector<Eigen::Vector3d> x_, x_rest_, x_next_;        // H, tet space
  std::vector<Eigen::Vector3d> y_, y_rest_, displacement_;  // M, local space
  std::vector<double> memory_;                              // of contact, local units
  std::vector<std::array<int, 4>> tets_;
  std::vector<double> rest_volumes_;
  std::vector<std::vector<int>> tets_of_;
  std::vector<std::vector<Weighted>> edges_of_;  // weight: rest length
  std::vector<std::vector<Weighted>> map_, gather_;
  double mean_edge_, memory_limit_;
  Eigen::Matrix3d to_local_;  // linear part, tet space to M's local space
};

}  // namespace knead::bench
