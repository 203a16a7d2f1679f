// A graph of toys on the fake device.
#pragma once
#include <string>

#include "io/graph_file.h"
#include "tests/graph/fake_device.h"
#include "tests/graph/toys.h"

namespace knead {
namespace toys {

// `nodes`: the lines below `nodes:`.
inline std::shared_ptr<const Plan> plan_of(const std::string& nodes) {
  return compile(read_graph_text("knead: 1\nnodes:\n" + nodes, "t.yaml"), options());
}

struct OnFake {
  explicit OnFake(const std::string& nodes, size_t capacity = size_t{1} << 30, int batch = 0)
      : fake(capacity, batch), evaluator(plan_of(nodes), on_device()) {}
  EvaluatorOptions on_device() {
    EvaluatorOptions made;
    made.executor = &fake.executor;
    return made;
  }
  double get(const std::string& output, int frame = 1) { return first(evaluator.get<Numbers>(output, frame)); }
  fake_device::FakeDevice fake;
  Evaluator evaluator;
};

}  // namespace toys
}  // namespace knead
