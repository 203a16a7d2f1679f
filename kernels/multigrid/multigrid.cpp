#include "kernels/multigrid/multigrid.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "graph/error.h"
#include "kernels/equilibrium/energy_simd.h"
#include "kernels/parallel.h"

namespace knead {
namespace {

constexpr uint32_t kCoarsest = 40;    // Grids are made until one has at most this many nodes: few enough for a dense inverse.
constexpr uint32_t kDense = 200;      // The coarsest grid has a dense inverse up to this many nodes, when no coarser grid could be made.
constexpr double kWorthAGrid = 0.4;   // A grid with more than this part of the finer grid's nodes is left out, and the next one tried.
constexpr int kDegree = 2;            // Steps of the smoother; one step takes 53 iterations for 37 (docs/convergence.md, Time).
constexpr int kCoarsestDegree = 16;   // Steps of the smoother where the coarsest grid is too large for an inverse.
constexpr float kShift = 1e-5f;       // Part of the coarsest diagonal that is added to it: trilinear weights may be linearly dependent.
constexpr size_t kRows = 128;         // A piece of rows is tens of microseconds of work.
constexpr int32_t kWidest = 1 << 20;  // The widest spacing of a grid, within what a position can tell.
constexpr int kPowerSteps = 20;       // Steps of the power method towards a largest eigenvalue.
constexpr float kSafety = 1.25f;      // The eigenvalue may be so many times larger, after the power method and in another shape.

// A body over rows: on a device itself, else the code for the processor's lanes.
template <class Body>
void run_rows(Executor& executor, uint32_t n, const Body& body, void (*run)(const Body&, size_t, size_t)) {
  if (executor.device() != Device{}) return executor.launch(body, n);
  executor.parallel_ranges(n, kRows, [&](size_t begin, size_t end) { run(body, begin, end); });
}

// Step k of the smoother's polynomial. A first step knows no x before: x takes its place and the factors make up for it.
void smooth_step(Executor& executor, const EnergySimd& lanes, const MultigridLevel& level, int k, bool first, const Row4* right, const Row4* before,
                 const Row4* now, Row4* to) {
  const float again = k == 1 ? 0 : static_cast<float>(2 * k - 3) / static_cast<float>(2 * k + 1);
  const float by = static_cast<float>(8 * k - 4) / (static_cast<float>(2 * k + 1) * level.largest);
  const float keep = first ? 1 + 2 * again : 1 + again;
  run_rows(executor, level.size, Smooth{level.a, right, first ? now : before, now, to, keep, again, by}, lanes.smooth);
}

// `degree` steps of the smoother from zero towards A^-1 right; the result is in `now`.
void smooth_from_zero(Executor& executor, const EnergySimd& lanes, const MultigridLevel& level, int degree, const Row4* right, Row4*& now,
                      Row4*& other) {
  parallel_for(executor, level.size, SmoothStart{level.a, right, now, 4 / (3 * level.largest)}, kRows);
  for (int k = 2; k <= degree; ++k) {
    smooth_step(executor, lanes, level, k, k == 2, right, other, now, other);
    std::swap(now, other);
  }
}

SparseRows pattern_of(size_t rows, std::span<const std::array<uint32_t, 2>> edges) {
  SparseRows pattern;
  pattern.offsets.assign(rows + 1, 0);
  for (const auto& [a, b] : edges) ++pattern.offsets[a + 1], ++pattern.offsets[b + 1];
  for (size_t p = 0; p < rows; ++p) pattern.offsets[p + 1] += pattern.offsets[p];
  pattern.index.resize(2 * edges.size());
  std::vector<uint32_t> cursor(pattern.offsets.begin(), pattern.offsets.end() - 1);
  for (const auto& [a, b] : edges) {
    pattern.index[cursor[a]++] = b;
    pattern.index[cursor[b]++] = a;
  }
  return pattern;
}

// Rows of a pattern as unions of others: numbers the columns of one row after the other.
class RowUnion {
 public:
  explicit RowUnion(uint32_t columns) : at_(columns, kNone) {}
  void meet(uint32_t column) {
    if (at_[column] == kNone) at_[column] = 0, met_.push_back(column);
  }
  // The row is complete: columns in rising order.
  const std::vector<uint32_t>& close() {
    std::sort(met_.begin(), met_.end());
    for (uint32_t k = 0; k < met_.size(); ++k) at_[met_[k]] = k;
    return met_;
  }
  uint32_t place(uint32_t column) const { return at_[column]; }
  void open() {
    for (const uint32_t c : met_) at_[c] = kNone;
    met_.clear();
  }

 private:
  static constexpr uint32_t kNone = 0xffffffffu;
  std::vector<uint32_t> at_, met_;
};

uint16_t as_place(uint32_t place) {
  if (place >= CoarseRow::kOwn) throw Error(ErrorCode::kInput, "equilibrium: a vertex of H has too many neighbours for a multigrid metric");
  return static_cast<uint16_t>(place);
}

Buffer<float> blocks(Executor& executor, size_t count) {
  return Buffer<float>(kBlock * count, executor.memory());
}

}  // namespace

MultigridGrids::MultigridGrids(Executor& host, const std::vector<GridPosition>& positions, std::span<const std::array<uint32_t, 2>> edges,
                               std::span<const float> free, const std::function<void()>& check)
    : grids_(1) {
  grids_[0].matrix = pattern_of(positions.size(), edges);
  GridPosition origin{0, 0, 0};
  std::vector<GridPosition> at = positions;
  for (int32_t spacing = kGridUnit; at.size() > kCoarsest && spacing < kWidest; spacing *= 2) {
    if (check) check();
    origin = origin_of_next(positions, origin, spacing);
    CoarseGrid coarse = coarsen(at, grids_.back().matrix, grids_.size() == 1 ? free : std::span<const float>{}, origin, 2 * spacing);
    if (static_cast<double>(coarse.positions.size()) > kWorthAGrid * static_cast<double>(at.size())) continue;
    grids_.back().up = std::move(coarse.up);
    grids_.back().down = std::move(coarse.down);
    SparseRows pattern = find_products(grids_.back());
    grids_.emplace_back();
    grids_.back().matrix = std::move(pattern);
    at = std::move(coarse.positions);
  }
  make_device_tables(host);
}

// The patterns of A P and of P^T A P, which is returned without its diagonal, and where the terms of both go.
SparseRows MultigridGrids::find_products(Grid& fine) {
  const uint32_t columns = fine.down.rows();
  const SparseRows &a = fine.matrix, &up = fine.up, &down = fine.down;
  SparseRows &product = fine.product, coarse;
  RowUnion row(columns);
  const auto each_term = [&](uint32_t p, auto&& take) {
    for (uint32_t g = up.offsets[p]; g < up.offsets[p + 1]; ++g) take(up.index[g]);
    for (uint32_t e = a.offsets[p]; e < a.offsets[p + 1]; ++e)
      for (uint32_t g = up.offsets[a.index[e]]; g < up.offsets[a.index[e] + 1]; ++g) take(up.index[g]);
  };
  fine.product_terms.assign(1, 0);
  for (uint32_t p = 0; p < a.rows(); ++p, row.open()) {
    each_term(p, [&](uint32_t c) { row.meet(c); });
    const std::vector<uint32_t>& met = row.close();
    product.index.insert(product.index.end(), met.begin(), met.end());
    product.offsets.push_back(static_cast<uint32_t>(product.index.size()));
    each_term(p, [&](uint32_t c) { fine.product_places.push_back(as_place(row.place(c))); });
    fine.product_terms.push_back(static_cast<uint32_t>(fine.product_places.size()));
  }
  fine.coarse_terms.assign(1, 0);
  for (uint32_t p = 0; p < columns; ++p, row.open()) {
    const auto each = [&](auto&& take) {
      for (uint32_t e = down.offsets[p]; e < down.offsets[p + 1]; ++e)
        for (uint32_t f = product.offsets[down.index[e]]; f < product.offsets[down.index[e] + 1]; ++f) take(product.index[f]);
    };
    each([&](uint32_t c) {
      if (c != p) row.meet(c);
    });
    const std::vector<uint32_t>& met = row.close();
    coarse.index.insert(coarse.index.end(), met.begin(), met.end());
    coarse.offsets.push_back(static_cast<uint32_t>(coarse.index.size()));
    each([&](uint32_t c) { fine.coarse_places.push_back(c == p ? CoarseRow::kOwn : as_place(row.place(c))); });
    fine.coarse_terms.push_back(static_cast<uint32_t>(fine.coarse_places.size()));
  }
  return coarse;
}

void MultigridGrids::make_device_tables(Executor& executor) {
  levels_.resize(grids_.size());
  for (size_t k = 0; k < grids_.size(); ++k) {
    const Grid& grid = grids_[k];
    MultigridLevel& level = levels_[k];
    level.size = grid.matrix.rows();
    level.entries = grid.matrix.index.size();
    level.a.offsets = device_tables_(executor, grid.matrix.offsets);
    level.a.index = device_tables_(executor, grid.matrix.index);
    level.up = {device_tables_(executor, grid.up.offsets), device_tables_(executor, grid.up.index), device_tables_(executor, grid.up.value)};
    level.down = {device_tables_(executor, grid.down.offsets), device_tables_(executor, grid.down.index), device_tables_(executor, grid.down.value)};
    level.product = device_tables_(executor, grid.product.offsets);
    level.product_terms = device_tables_(executor, grid.product_terms);
    level.product_places = device_tables_(executor, grid.product_places);
    level.coarse_terms = device_tables_(executor, grid.coarse_terms);
    level.coarse_places = device_tables_(executor, grid.coarse_places);
    level.products = grid.product.index.size();
  }
}

size_t MultigridGrids::work_rows() const {
  size_t rows = 0;
  for (size_t k = 0; k < levels_.size(); ++k) rows += (k == 0 ? 2 : 3) * MultigridLevel::padded(levels_[k].size);
  return rows;
}

double MultigridGrids::bytes() const {
  double sum = 16.0 * static_cast<double>(work_rows());
  for (size_t k = 0; k < grids_.size(); ++k) {
    const Grid& grid = grids_[k];
    sum += static_cast<double>(grid.matrix.bytes() + grid.up.bytes() + grid.down.bytes() + grid.product.bytes() +
                               4 * kBlock * grid.product.index.size());
    sum += 4.0 * static_cast<double>(grid.product_terms.size() + grid.coarse_terms.size()) +
           2.0 * static_cast<double>(grid.product_places.size() + grid.coarse_places.size());
    sum += 2 * 4.0 * kBlock * static_cast<double>(levels_[k].entries + 2 * levels_[k].size);
  }
  return sum;
}

double MultigridGrids::expected_bytes(size_t vertices, size_t edges) {
  return 300.0 * static_cast<double>(vertices) + 500.0 * static_cast<double>(edges);
}

// The power method, from a vector of signs.
void MultigridGrids::measure(Executor& host, const EnergySimd& lanes, const Hessian& rest) {
  const Multigrid metric(host, *this, rest, nullptr);
  for (size_t k = 0; k < levels_.size(); ++k) {
    const MultigridLevel& level = metric.levels()[k];
    const size_t rows = MultigridLevel::padded(level.size);
    Buffer<Row4> x(rows), y(rows), zero(rows);
    Row4 *now = x.data_for_write(), *next = y.data_for_write(), *none = zero.data_for_write();
    std::fill_n(none, rows, Row4{0, 0, 0, 0});
    std::minstd_rand bits;
    const auto sign = [&] { return bits() % 2 == 0 ? 1.0f : -1.0f; };
    for (size_t p = 0; p < level.size; ++p) now[p] = {sign(), sign(), sign(), 0};
    const auto squares = [&](const Row4* v) {
      double sum = 0;
      for (size_t p = 0; p < level.size; ++p) sum += static_cast<double>(dot(to_vec(v[p]), to_vec(v[p])));
      return sum;
    };
    double before = squares(now), largest = 1;
    for (int step = 0; step < kPowerSteps && before > 0; ++step) {
      run_rows(host, level.size, Smooth{level.a, none, now, now, next, 0, 0, -1}, lanes.smooth);
      const double after = squares(next);
      largest = std::sqrt(after / before);
      const float over = after > 0 ? static_cast<float>(1 / std::sqrt(after)) : 0;
      for (size_t p = 0; p < level.size; ++p) next[p] = to_row(over * to_vec(next[p]));
      std::swap(now, next);
      before = squares(now);
    }
    levels_[k].largest = std::max(1.0f, kSafety * static_cast<float>(largest));
  }
}

namespace {

// P^T A P of a grid, or of a diagonal alone, which is added. `changed`: the rows of A that have since the last time; null: all.
void make_coarse(Executor& executor, const MultigridLevel& fine, const MultigridLevel& coarse, bool diagonal_only, float* value, float* diagonal,
                 const uint8_t* changed = nullptr) {
  Buffer<uint8_t> marks;  // of coarse rows to be made, then of the fine ones that they are made of
  uint8_t *made = nullptr, *needed = nullptr;
  if (changed) {
    marks = Buffer<uint8_t>(size_t{coarse.size} + fine.size, executor.memory());
    made = marks.data_for_write();
    needed = made + coarse.size;
    parallel_for(executor, coarse.size, MarkRows{fine.down.offsets, fine.down.index, changed, made});
    parallel_for(executor, fine.size, MarkRows{fine.up.offsets, fine.up.index, made, needed});
  }
  Buffer<float> product = blocks(executor, fine.products);
  float* rows = product.data_for_write();
  parallel_for(executor, fine.size, ProductRow{fine.a, fine.up, fine.product_terms, fine.product_places, fine.product, rows, diagonal_only, needed},
               kRows);
  parallel_for(executor, coarse.size,
               CoarseRow{fine.down, fine.product, rows, fine.coarse_terms, fine.coarse_places, coarse.a.offsets, value, diagonal,
                         diagonal_only ? fine.a.diagonal : nullptr, made},
               32);
}

}  // namespace

Hessian make_hessian(Executor& executor, const MultigridGrids& grids, Buffer<float> entries, Buffer<float> diagonal) {
  Hessian made{std::move(entries), std::move(diagonal), {}, {}};
  if (grids.levels().size() > 1) {
    made.coarse_entries = blocks(executor, grids.levels()[1].entries);
    made.coarse_diagonal = blocks(executor, grids.levels()[1].size);
    renew_coarse(executor, grids, made, nullptr);
  }
  return made;
}

void renew_coarse(Executor& executor, const MultigridGrids& grids, Hessian& hessian, const uint8_t* changed) {
  if (grids.levels().size() == 1) return;
  MultigridLevel fine = grids.levels()[0];
  fine.a.value = hessian.entries.view(executor.device()).data();
  fine.a.diagonal = hessian.diagonal.view(executor.device()).data();
  make_coarse(executor, fine, grids.levels()[1], false, hessian.coarse_entries.data_for_write(), hessian.coarse_diagonal.data_for_write(), changed);
}

Multigrid::Multigrid(Executor& executor, const MultigridGrids& grids, const Hessian& hessian, const float* added) : levels_(grids.levels()) {
  const Device device = executor.device();
  const auto sum = [&](const Buffer<float>& a, const float* b) {
    Buffer<float> to(a.size(), executor.memory());
    parallel_for(executor, a.size(), AddFloats{a.view(device).data(), b, to.data_for_write()}, 1 << 14);
    return to;
  };
  values_.resize(levels_.size());
  for (size_t k = 0; k < levels_.size(); ++k) {
    Values& values = values_[k];
    MultigridLevel& level = levels_[k];
    if (k == 0) {
      values.entries = hessian.entries;
      values.diagonal = sum(hessian.diagonal, added);
    } else {
      MultigridLevel finer = levels_[k - 1];
      values.entries = k == 1 ? sum(hessian.coarse_entries, nullptr) : blocks(executor, level.entries);
      values.diagonal = k == 1 ? sum(hessian.coarse_diagonal, nullptr) : blocks(executor, level.size);
      if (k == 1) finer.a.diagonal = added;
      if (k > 1 || added) make_coarse(executor, finer, level, k == 1, values.entries.data_for_write(), values.diagonal.data_for_write());
    }
    values.inverse = blocks(executor, level.size);
    parallel_for(executor, level.size, InverseOfDiagonal{values.diagonal.view(device).data(), values.inverse.data_for_write()});
    level.a.value = values.entries.view(device).data();
    level.a.diagonal = values.diagonal.view(device).data();
    level.a.inverse = values.inverse.view(device).data();
  }
  invert_coarsest(executor);
}

void Multigrid::invert_coarsest(Executor& executor) {
  const MultigridLevel& last = levels_.back();
  if (last.size > kDense) return;
  const uint32_t n = 3 * last.size;
  inverse_ = Buffer<double>(size_t{n} * n, executor.memory());
  Buffer<double> other(inverse_.size(), executor.memory());
  double *from = inverse_.data_for_write(), *to = other.data_for_write();
  parallel_for(executor, last.size, DenseRows{last.a, kShift, from, last.size});
  for (uint32_t k = 0; k < n; ++k) {
    parallel_for(executor, n, InvertColumn{from, to, n, k});
    std::swap(from, to);
  }
  if (n % 2 == 1) std::swap(inverse_, other);
}

void Multigrid::solve_coarsest(Executor& executor, const EnergySimd& lanes, Row4* x, Row4* work) const {
  const MultigridLevel& last = levels_.back();
  Row4 *now = work, *other = now + MultigridLevel::padded(last.size);
  if (inverse_)
    parallel_for(executor, last.size, DenseTimes{inverse_.view(executor.device()).data(), last.size, x, now});
  else
    smooth_from_zero(executor, lanes, last, kCoarsestDegree, x, now, other);
  parallel_for(executor, last.size, CopyRows{now, x});
}

// x <- M x, in place.
void Multigrid::cycle(Executor& executor, const EnergySimd& lanes, size_t k, Row4* x, Row4* work) const {
  if (k + 1 == levels_.size()) return solve_coarsest(executor, lanes, x, work);
  const MultigridLevel& level = levels_[k];
  const uint32_t n = level.size, m = levels_[k + 1].size;
  Row4 *now = work, *other = now + MultigridLevel::padded(n), *coarse = other + MultigridLevel::padded(n);
  smooth_from_zero(executor, lanes, level, kDegree, x, now, other);
  run_rows(executor, n, Residual{level.a, x, now, other}, lanes.residual);
  parallel_for(executor, m, Restrict{level.down, other, coarse}, kRows);
  cycle(executor, lanes, k + 1, coarse, coarse + MultigridLevel::padded(m));
  parallel_for(executor, n, Prolong{level.up, coarse, now}, kRows);
  for (int step = 1; step < kDegree; ++step) {
    smooth_step(executor, lanes, level, step, step == 1, x, other, now, other);
    std::swap(now, other);
  }
  smooth_step(executor, lanes, level, kDegree, kDegree == 1, x, other, now, x);
}

void Multigrid::solve(Executor& executor, const EnergySimd& lanes, Row4* x, Row4* work, size_t grid) const {
  std::vector<Row4*> rows{x};
  for (size_t k = 0; k < grid; ++k) {
    rows.push_back(work);
    work += MultigridLevel::padded(levels_[k + 1].size);
    parallel_for(executor, levels_[k + 1].size, Restrict{levels_[k].down, rows[k], rows[k + 1]}, kRows);
  }
  cycle(executor, lanes, grid, rows[grid], work);
  for (size_t k = grid; k-- > 0;) {
    parallel_for(executor, 4 * size_t{levels_[k].size}, FillWords{reinterpret_cast<uint32_t*>(rows[k]), 0}, 1 << 14);
    parallel_for(executor, levels_[k].size, Prolong{levels_[k].up, rows[k + 1], rows[k]}, kRows);
  }
}

}  // namespace knead
