#include "kernels/multigrid.h"

#include <algorithm>
#include <cmath>

#include "kernels/energy_lanes.h"
#include "kernels/nested_dissection.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

constexpr uint32_t kCoarsest = 300;   // nodes that are few enough for a factor
constexpr double kWorthAGrid = 0.4;   // of the nodes: a grid with more is left out, and the next one tried
constexpr int kDegree = 3;            // of the smoother
constexpr size_t kRows = 2048;        // per piece
constexpr int32_t kWidest = 1 << 20;  // spacing

// A body over rows: on a device itself, else the code for the processor's lanes.
template <class Body>
void run_rows(Executor& executor, uint32_t n, const Body& body, void (*run)(const Body&, size_t, size_t)) {
  if (executor.device() != Device{}) return executor.launch(body, n);
  executor.parallel_ranges(n, kRows, [&](size_t begin, size_t end) { run(body, begin, end); });
}

// Step k of the smoother's polynomial. A first step knows no x before: x takes its place and the factors make up for it.
void smooth_step(Executor& executor, const EnergyLanes& lanes, const MultigridLevel& level, int k, bool first, const Row4* right, const Row4* before,
                 const Row4* now, Row4* to) {
  const float again = k == 1 ? 0 : static_cast<float>(2 * k - 3) / static_cast<float>(2 * k + 1);
  const float by = static_cast<float>(8 * k - 4) / static_cast<float>(2 * k + 1);
  const float keep = first ? 1 + 2 * again : 1 + again;
  run_rows(executor, level.size, Smooth{level.a, right, first ? now : before, now, to, keep, again, by}, lanes.smooth);
}

}  // namespace

void smooth_from_zero(Executor& executor, const EnergyLanes& lanes, const MultigridLevel& level, int degree, const Row4* right, Row4*& now,
                      Row4*& other) {
  parallel_for(executor, level.size, "multigrid_start", SmoothStart{level.a.inverse, right, now, 4.0f / 3}, kRows);
  for (int k = 2; k <= degree; ++k) {
    smooth_step(executor, lanes, level, k, k == 2, right, other, now, other);
    std::swap(now, other);
  }
}

void multigrid_cycle(Executor& executor, const EnergyLanes& lanes, std::span<const MultigridLevel> levels,
                     FunctionRef<void(Row4* x, Row4* work)> coarsest, Row4* x, Row4* work) {
  const MultigridLevel& level = levels.front();
  if (levels.size() == 1) return coarsest(x, work);
  const uint32_t n = level.size, m = levels[1].size;
  Row4 *now = work, *other = now + MultigridLevel::padded(n), *coarse = other + MultigridLevel::padded(n);
  smooth_from_zero(executor, lanes, level, kDegree, x, now, other);
  run_rows(executor, n, Residual{level.a, x, now, other}, lanes.residual);
  parallel_for(executor, m, "multigrid_restrict", Restrict{level.down, other, coarse}, kRows);
  multigrid_cycle(executor, lanes, levels.subspan(1), coarsest, coarse, coarse + MultigridLevel::padded(m));
  parallel_for(executor, n, "multigrid_prolong", Prolong{level.up, coarse, now}, kRows);
  for (int k = 1; k < kDegree; ++k) {
    smooth_step(executor, lanes, level, k, k == 1, x, other, now, other);
    std::swap(now, other);
  }
  smooth_step(executor, lanes, level, kDegree, kDegree == 1, x, other, now, x);
}

size_t multigrid_work(std::span<const MultigridLevel> levels) {
  size_t rows = 0;
  for (size_t level = 0; level + 1 < levels.size(); ++level) rows += (level == 0 ? 2 : 3) * MultigridLevel::padded(levels[level].size);
  return rows;
}

MatrixRows Multigrid::matrix(size_t level) const {
  const SparseRows& pattern = (*grids_)[level].matrix;
  const Values& values = values_[level];
  return {pattern.offsets.data(), pattern.index.data(), values.entries->data(), values.diagonal.data(), values.inverse.data()};
}

std::vector<float> Multigrid::by_row(const SparseRows& pattern, std::span<const float> by_edge) {
  std::vector<float> values(pattern.index.size());
  std::vector<uint32_t> cursor(pattern.offsets.begin(), pattern.offsets.end() - 1);
  size_t edge = 0;  // those of a row lie behind its lower neighbours, in the order of the edges
  for (uint32_t p = 0; p < pattern.rows(); ++p)
    for (uint32_t e = cursor[p]; e < pattern.offsets[p + 1]; ++e, ++edge) {
      values[e] = by_edge[edge];
      values[cursor[pattern.index[e]]++] = by_edge[edge];
    }
  return values;
}

void Multigrid::set_fine(std::span<const float> entries, std::span<const float> diagonal) {
  values_.resize(1);
  values_[0].entries = std::make_shared<const std::vector<float>>(by_row(grids_->front().matrix, entries));
  values_[0].diagonal.assign(diagonal.begin(), diagonal.end());
}

void Multigrid::make_inverse(Executor& executor, size_t level) {
  std::vector<float>& inverse = values_[level].inverse;
  inverse.resize(size(level));
  parallel_for(executor, inverse.size(), "multigrid_inverse", InverseOfRows{matrix(level), inverse.data()});
}

SparseRows Multigrid::galerkin(Executor& executor, size_t level) const {
  const Grid& fine = (*grids_)[level];
  const uint32_t coarse = fine.down.rows();
  const SparseRows a{fine.matrix.offsets, fine.matrix.index, *values_[level].entries};
  return multiplied(executor, fine.down, {}, multiplied(executor, a, values_[level].diagonal, fine.up, coarse), coarse);
}

// A product has its diagonal among its entries; every node has one.
void Multigrid::take(size_t level, const SparseRows& product, bool first) {
  SparseRows beside;
  Values values;
  values.diagonal.resize(product.rows());
  std::vector<float> entries;
  for (uint32_t p = 0; p < product.rows(); ++p) {
    for (uint32_t e = product.offsets[p]; e < product.offsets[p + 1]; ++e) {
      if (product.index[e] == p) {
        values.diagonal[p] = product.value[e];
        continue;
      }
      if (first) beside.index.push_back(product.index[e]);
      entries.push_back(product.value[e]);
    }
    if (first) beside.offsets.push_back(static_cast<uint32_t>(beside.index.size()));
  }
  if (first) (*grids_)[level].matrix = std::move(beside);
  values.entries = std::make_shared<const std::vector<float>>(std::move(entries));
  values_.resize(level);
  values_.push_back(std::move(values));
}

Multigrid::Multigrid(Executor& executor, const EnergyLanes& lanes, const std::vector<GridPlace>& places,
                     std::span<const std::array<uint32_t, 2>> edges, std::span<const float> free, std::span<const float> entries,
                     std::span<const float> diagonal, const std::function<void()>& check)
    : grids_(std::make_shared<std::vector<Grid>>(1)), coarsest_(std::make_shared<Coarsest>()) {
  SparseRows& fine = grids_->front().matrix;
  fine.offsets.assign(places.size() + 1, 0);
  for (const auto& [a, b] : edges) ++fine.offsets[a + 1], ++fine.offsets[b + 1];
  for (size_t p = 0; p < places.size(); ++p) fine.offsets[p + 1] += fine.offsets[p];
  fine.index.resize(2 * edges.size());
  std::vector<uint32_t> cursor(fine.offsets.begin(), fine.offsets.end() - 1);
  for (const auto& [a, b] : edges) {
    fine.index[cursor[a]++] = b;
    fine.index[cursor[b]++] = a;
  }
  set_fine(entries, diagonal);
  make_inverse(executor, 0);

  GridPlace origin{0, 0, 0};
  std::vector<GridPlace> at = places;
  for (int32_t spacing = kGridUnit; at.size() > kCoarsest && spacing < kWidest; spacing *= 2) {
    if (check) check();
    const size_t level = grids_->size() - 1;
    origin = origin_of_next(places, origin, spacing);
    CoarseGrid coarse = coarsen(at, grids_->back().matrix, level == 0 ? free : std::span<const float>{}, origin, 2 * spacing);
    if (static_cast<double>(coarse.places.size()) > kWorthAGrid * static_cast<double>(at.size())) continue;
    grids_->back().up = std::move(coarse.up);
    grids_->back().down = std::move(coarse.down);
    grids_->emplace_back();
    take(level + 1, galerkin(executor, level), true);
    make_inverse(executor, level + 1);
    at = std::move(coarse.places);
  }

  const SparseRows& last = grids_->back().matrix;
  std::vector<Vec3f> points;
  for (const GridPlace& p : at) points.push_back({static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])});
  for (uint32_t p = 0; p < last.rows(); ++p)
    for (uint32_t e = last.offsets[p]; e < last.offsets[p + 1]; ++e)
      if (p < last.index[e]) coarsest_->edges.push_back({p, last.index[e]});
  constexpr uint32_t kLeaf = 32;
  const Dissection dissection = nested_dissection(points, coarsest_->edges, kLeaf, check);
  coarsest_->place.resize(points.size());
  for (uint32_t p = 0; p < points.size(); ++p) coarsest_->place[dissection.order[p]] = p;
  for (auto& [a, b] : coarsest_->edges) a = coarsest_->place[a], b = coarsest_->place[b];
  coarsest_->plan = std::make_shared<const FactorPlan>(dissection, coarsest_->edges, check);
  factor_coarsest(executor, lanes, check);
}

void Multigrid::factor_coarsest(Executor& executor, const EnergyLanes& lanes, const std::function<void()>& check) {
  const SparseRows& pattern = grids_->back().matrix;
  const Values& values = values_.back();
  std::vector<float> entries, diagonal(pattern.rows());
  for (uint32_t p = 0; p < pattern.rows(); ++p) {
    diagonal[coarsest_->place[p]] = values.diagonal[p] * (1 + kShift);
    for (uint32_t e = pattern.offsets[p]; e < pattern.offsets[p + 1]; ++e)
      if (p < pattern.index[e]) entries.push_back((*values.entries)[e]);
  }
  factor_ = std::make_shared<const SparseCholesky>(executor, lanes, coarsest_->plan, entries, diagonal, check);
}

std::unique_ptr<Metric> Multigrid::remade(Executor& executor, const EnergyLanes& lanes, std::span<const float> entries,
                                          std::span<const float> diagonal, const std::function<void()>& check) const {
  auto made = std::unique_ptr<Multigrid>(new Multigrid);
  made->grids_ = grids_;
  made->coarsest_ = coarsest_;
  made->set_fine(entries, diagonal);
  made->make_inverse(executor, 0);
  for (size_t level = 0; level + 1 < grids_->size(); ++level) {
    if (check) check();
    made->take(level + 1, made->galerkin(executor, level), false);
    made->make_inverse(executor, level + 1);
  }
  made->factor_coarsest(executor, lanes, check);
  return made;
}

// P^T D P of a coarse grid, vertex by vertex: a vertex's weights there are those of the grids between, multiplied.
void Multigrid::add_to_coarse(size_t level, std::span<const uint32_t> changed, std::span<const float> by) {
  struct Weight {
    uint32_t node;
    float weight;
  };
  auto entries = std::make_shared<std::vector<float>>(*values_[level].entries);
  std::vector<float>& diagonal = values_[level].diagonal;
  const SparseRows& pattern = (*grids_)[level].matrix;
  std::vector<Weight> row, next;
  for (size_t k = 0; k < changed.size(); ++k) {
    row.assign(1, {changed[k], 1.0f});
    for (size_t below = 0; below < level; ++below) {
      const SparseRows& up = (*grids_)[below].up;
      next.clear();
      for (const Weight& w : row)
        for (uint32_t e = up.offsets[w.node]; e < up.offsets[w.node + 1]; ++e) {
          const auto met = std::find_if(next.begin(), next.end(), [&](const Weight& n) { return n.node == up.index[e]; });
          if (met == next.end())
            next.push_back({up.index[e], w.weight * up.value[e]});
          else
            met->weight += w.weight * up.value[e];
        }
      row.swap(next);
    }
    for (const Weight& a : row) {
      diagonal[a.node] += by[k] * a.weight * a.weight;
      const auto begin = pattern.index.begin() + pattern.offsets[a.node], end = pattern.index.begin() + pattern.offsets[a.node + 1];
      for (const Weight& b : row)
        if (b.node != a.node)
          (*entries)[static_cast<size_t>(std::lower_bound(begin, end, b.node) - pattern.index.begin())] += by[k] * (a.weight * b.weight);
    }
  }
  values_[level].entries = std::move(entries);
}

std::unique_ptr<Metric> Multigrid::renewed(Executor& executor, const EnergyLanes& lanes, std::span<const float> diagonal,
                                           const std::function<void()>& check) const {
  auto made = std::unique_ptr<Multigrid>(new Multigrid(*this));
  std::vector<uint32_t> changed;
  std::vector<float> by;
  Values& fine = made->values_[0];
  for (uint32_t p = 0; p < diagonal.size(); ++p) {
    if (diagonal[p] == fine.diagonal[p]) continue;
    changed.push_back(p);
    by.push_back(diagonal[p] - fine.diagonal[p]);
  }
  fine.diagonal.assign(diagonal.begin(), diagonal.end());
  executor.parallel_ranges(levels() - 1, 1, [&](size_t level, size_t) { made->add_to_coarse(level + 1, changed, by); });
  for (size_t level = 0; level < levels(); ++level) made->make_inverse(executor, level);
  made->factor_coarsest(executor, lanes, check);
  return made;
}

std::vector<MultigridLevel> Multigrid::views() const {
  std::vector<MultigridLevel> views;
  for (size_t level = 0; level < levels(); ++level) {
    const SparseRows &up = (*grids_)[level].up, &down = (*grids_)[level].down;
    views.push_back({static_cast<uint32_t>(size(level)), matrix(level), {up.offsets.data(), up.index.data(), up.value.data()},
                     {down.offsets.data(), down.index.data(), down.value.data()}});
  }
  return views;
}

size_t Multigrid::scratch_floats() const {
  return 4 * (multigrid_work(views()) + padded(size(levels() - 1)) + factor_->solve_rows()) + factor_->scratch_floats();
}

void Multigrid::solve(Executor& executor, const EnergyLanes& lanes, Row4* x, float* scratch) const {
  const auto coarsest = [&](Row4* right, Row4* work) {
    const size_t n = size(levels() - 1);
    for (size_t p = 0; p < n; ++p) work[coarsest_->place[p]] = right[p];
    factor_->solve(executor, lanes, work, &work[factor_->solve_rows()].x);
    for (size_t p = 0; p < n; ++p) right[p] = work[coarsest_->place[p]];
  };
  multigrid_cycle(executor, lanes, views(), coarsest, x, reinterpret_cast<Row4*>(scratch));
}

double Multigrid::bytes() const {
  double sum = 0;
  for (size_t level = 0; level < levels(); ++level) {
    const Grid& grid = (*grids_)[level];
    sum += static_cast<double>(grid.matrix.bytes() + grid.up.bytes() + grid.down.bytes());
    sum += 4.0 * static_cast<double>(values_[level].entries->size() + 2 * values_[level].diagonal.size());
  }
  return sum + coarsest_->plan->bytes();
}

}  // namespace knead
