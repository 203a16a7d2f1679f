#include "kernels/neighbour_table.h"

#include <gtest/gtest.h>

#include <random>

#include "graph/error.h"

namespace knead {
namespace neighbour_table_test {

struct Made {
  std::vector<uint32_t> offsets{0}, indices;
  std::vector<float> values;
  uint32_t columns = 1;
  Adjacency adjacency() const { return {offsets, indices, values, columns}; }
};

Made random_adjacency(uint32_t vertices, uint32_t columns, uint32_t largest, uint32_t seed) {
  std::mt19937 random(seed);
  Made made;
  made.columns = columns;
  for (uint32_t v = 0; v < vertices; ++v) {
    const uint32_t valence = random() % (largest + 1);
    for (uint32_t k = 0; k < valence; ++k) {
      for (uint32_t c = 0; c < columns; ++c) made.indices.push_back(random() % vertices);
      made.values.push_back(static_cast<float>(1 + random() % 1000));
    }
    made.offsets.push_back(static_cast<uint32_t>(made.values.size()));
  }
  return made;
}

void expect_given_back(const Made& made, const NeighbourTable& table) {
  const uint32_t vertices = static_cast<uint32_t>(made.offsets.size() - 1);
  const auto rows = neighbours_by_vertex(table, vertices);
  for (uint32_t v = 0; v < vertices; ++v) {
    ASSERT_EQ(rows[v].size(), made.offsets[v + 1] - made.offsets[v]);
    for (size_t k = 0; k < rows[v].size(); ++k) {
      const size_t e = made.offsets[v] + k;
      EXPECT_EQ(rows[v][k].value, made.values[e]);
      for (uint32_t c = 0; c < made.columns; ++c) EXPECT_EQ(rows[v][k].indices[c], made.indices[e * made.columns + c]);
    }
  }
}

TEST(NeighbourTable, GivesEveryNeighbourBackInOrder) {
  const auto executor = make_serial_executor();
  for (uint32_t columns : {1u, 3u})
    for (uint32_t vertices : {1u, 15u, 16u, 17u, 1000u}) {
      const Made made = random_adjacency(vertices, columns, 9, vertices + columns);
      const NeighbourTable table = make_neighbour_table(made.adjacency(), PadIndex::kOwnVertex, Lanes::kAll, *executor);
      EXPECT_EQ(check_neighbour_table(table, vertices, PadIndex::kOwnVertex), "");
      EXPECT_EQ(table.lanes, vertices);
      expect_given_back(made, table);
    }
}

TEST(NeighbourTable, KeepsTheOrderOfVerticesWithinOneValence) {
  const auto executor = make_serial_executor();
  Made made;
  for (uint32_t valence : {2u, 1u, 2u, 0u, 1u}) {
    for (uint32_t k = 0; k < valence; ++k) {
      made.indices.push_back(k);
      made.values.push_back(1);
    }
    made.offsets.push_back(static_cast<uint32_t>(made.values.size()));
  }
  const NeighbourTable table = make_neighbour_table(made.adjacency(), PadIndex::kZero, Lanes::kAll, *executor);
  const auto order = table.order.host();
  EXPECT_EQ(std::vector<uint32_t>(order.begin(), order.begin() + 5), (std::vector<uint32_t>{0, 2, 1, 4, 3}));
  EXPECT_EQ(order.size(), 16u);
  EXPECT_EQ(order[15], 3u);
}

TEST(NeighbourTable, LeavesOutVerticesWithoutNeighboursWhenAsked) {
  const auto executor = make_serial_executor();
  const Made made = random_adjacency(200, 1, 2, 7);
  const NeighbourTable table = make_neighbour_table(made.adjacency(), PadIndex::kZero, Lanes::kWithNeighbours, *executor);
  EXPECT_EQ(check_neighbour_table(table, 200, PadIndex::kZero), "");
  EXPECT_LT(table.lanes, 200u);
  EXPECT_GT(table.valence.host()[table.lanes - 1], 0u);
  expect_given_back(made, table);
}

TEST(NeighbourTable, TakesNoVerticesAndNoNeighbours) {
  const auto executor = make_serial_executor();
  const Made none;
  const NeighbourTable empty = make_neighbour_table(none.adjacency(), PadIndex::kZero, Lanes::kAll, *executor);
  EXPECT_EQ(empty.lanes, 0u);
  EXPECT_EQ(check_neighbour_table(empty, 0, PadIndex::kZero), "");
  const Made lonely = random_adjacency(3, 1, 0, 1);
  const NeighbourTable table = make_neighbour_table(lonely.adjacency(), PadIndex::kOwnVertex, Lanes::kAll, *executor);
  EXPECT_EQ(table.largest, 0u);
  EXPECT_EQ(check_neighbour_table(table, 3, PadIndex::kOwnVertex), "");
  EXPECT_EQ(make_neighbour_table(lonely.adjacency(), PadIndex::kZero, Lanes::kWithNeighbours, *executor).lanes, 0u);
}

TEST(NeighbourTable, IsTheSameForAnyNumberOfThreads) {
  const Made made = random_adjacency(20000, 3, 30, 11);
  const auto serial = make_serial_executor(), parallel = make_cpu_executor(2);
  const NeighbourTable a = make_neighbour_table(made.adjacency(), PadIndex::kOwnVertex, Lanes::kAll, *serial);
  const NeighbourTable b = make_neighbour_table(made.adjacency(), PadIndex::kOwnVertex, Lanes::kAll, *parallel);
  EXPECT_TRUE(std::ranges::equal(a.indices.host(), b.indices.host()));
  EXPECT_TRUE(std::ranges::equal(a.values.host(), b.values.host()));
}

TEST(NeighbourTable, CheckFindsWhatIsWrong) {
  const auto executor = make_serial_executor();
  const Made made = random_adjacency(100, 1, 5, 3);
  NeighbourTable table = make_neighbour_table(made.adjacency(), PadIndex::kOwnVertex, Lanes::kAll, *executor);
  EXPECT_NE(check_neighbour_table(table, 50, PadIndex::kOwnVertex), "");
  EXPECT_NE(check_neighbour_table(table, 100, PadIndex::kZero), "");
  table.valence.data_for_write()[1] = 99;
  EXPECT_NE(check_neighbour_table(table, 100, PadIndex::kOwnVertex), "");
}

TEST(NeighbourTable, RefusesOffsetsThatDisagree) {
  const auto executor = make_serial_executor();
  Made made = random_adjacency(10, 1, 5, 3);
  made.values.push_back(1);
  EXPECT_THROW(make_neighbour_table(made.adjacency(), PadIndex::kZero, Lanes::kAll, *executor), Error);
}

}  // namespace neighbour_table_test
}  // namespace knead
