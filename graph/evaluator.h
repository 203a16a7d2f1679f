// Evaluates a plan: any frame, in any order, on any number of threads, with the same bits. Thread-safe.
//
// Evaluation for given targets: keys in topological order (node type and version, parameters, input keys, frame where it matters), then only what the
// cache lacks runs, independent nodes at once. Values between nodes are moved here: a node that runs on the device gets its inputs there, one that
// runs on the host gets them back, and a buffer is copied once for all its readers. Kernels copy besides what is theirs alone: tables that they keep
// on a device, and figures by which the host decides. Both kinds are counted, apart from each other. A node that fails stops only what needs it.
#pragma once
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "graph/cache.h"
#include "graph/plan.h"

namespace knead {

struct NodeTime {
  std::string name;
  double seconds = 0;   // in this frame, without waiting for parts that another frame or node makes for all
  bool cached = false;  // the result was there already: of another frame, or of the set-up
  double set_up = 0;    // what the set-up of evaluate_frames spent on the node for all frames; no frame's `seconds` holds it
};

struct FrameResult {
  int frame = 0;
  std::optional<Error> error;           // the frame failed; what was asked for is not there
  std::map<std::string, Value> values;  // by the reference that was asked for, on the host
  std::vector<NodeTime> times;          // in plan order; a loop's inner nodes follow it, summed over its rounds
  std::vector<std::string> warnings;    // "node 'tets': open surface ...", of the nodes that the frame stands on
  double seconds = 0;                   // wall clock
};

struct EvaluatorFigures {
  CacheFigures cache;
  std::map<std::string, uint64_t> evaluations;  // times a node of each type was really run; a loop counts once, its body not
  std::map<std::string, double> seconds;        // spent in each node by name, over all frames, with what was computed once for all of them
  std::map<std::string, double> set_up;         // of these, what was computed once for all frames of an evaluate_frames
  double set_up_seconds = 0;                    // wall clock
  Transfers moved;                              // buffers between nodes
  Transfers by_nodes;                           // what nodes copied besides; of all evaluators that share the executor since this one was made
};

struct EvaluatorOptions {
  // Executors, and the cache's values that live in their memory: the executors must outlive both the evaluator and the cache.
  Executor* executor = nullptr;       // where kAnyDevice nodes run; null: a cpu executor of its own
  Executor* host_executor = nullptr;  // where kHost nodes run; null: `executor` if that is a host executor, else a cpu executor of its own
  std::shared_ptr<Cache> cache;       // null: one of its own
  bool checked = false;               // prove that nodes read only what they declared, leave their inputs alone, and compute what is cached again
  std::function<bool()> cancelled;    // asked often, from any thread (graph/cancel.h)
};

class KNEAD_API Evaluator {
 public:
  struct Impl;  // internal
  explicit Evaluator(std::shared_ptr<const Plan> plan, EvaluatorOptions options = {});
  ~Evaluator();

  const Plan& plan() const;
  Executor& executor() const;

  // One frame, for the outputs named ("press.surface") and with every node that has an effect when `effects`. Throws nothing but programming errors
  // of the caller (an unknown reference); what goes wrong in the frame comes back in `error`.
  FrameResult evaluate(int frame, const std::vector<std::string>& outputs, bool effects = false);

  // Many frames, as many at once as there are threads, or as a device likes; those that find too little memory so are tried again alone. What does
  // not depend on the frame is computed first, once, and then the first frame's nodes that make what all share. This is the set-up: its figures are
  // NodeTime::set_up and EvaluatorFigures::set_up; what is the first frame's own work in it counts as that frame's. One frame alone has no set-up,
  // and its seconds hold everything. `done` is called once per frame, one call at a time, in the order in which frames end. A failed frame does not
  // stop the others; cancellation does: frames not finished are not reported.
  void evaluate_frames(const std::vector<int>& frames, const std::vector<std::string>& outputs, bool effects,
                       const std::function<void(FrameResult)>& done);

  // Identifies the inputs of everything that an effect node of this frame depends on, parameters included: equal keys mean equal files. For --resume.
  Key frame_key(int frame, const std::vector<std::string>& outputs, bool effects) const;

  template <class T>
  T get(const std::string& output, int frame) {  // throws the frame's Error
    FrameResult result = evaluate(frame, {output});
    if (result.error) throw *result.error;
    return result.values.at(output).template as<T>();
  }

  EvaluatorFigures figures() const;

 private:
  struct Prepared;
  Prepared prepare(int first, const std::vector<std::string>& outputs, bool effects);
  std::vector<int> run_frames(const std::vector<int>& frames, int at_once, const std::vector<std::string>& outputs, bool effects,
                              const std::function<void(FrameResult)>& done);
  std::unique_ptr<Impl> impl_;
};

}  // namespace knead
