// Evaluates one node without a graph: inputs by port, outputs kept, warnings collected, `once` remembered across evaluations.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "graph/node.h"
#include "graph/registry.h"
#include "kernels/port_types.h"
#include "kernels/sdf_sample.h"

namespace sdf_node_test {

class OneNode : public knead::Context {
 public:
  explicit OneNode(const std::string& type, int threads = 1)
      : node_(knead::Registry::builtin().find(type)->make()),
        executor_(threads > 1 ? knead::make_cpu_executor(threads) : knead::make_serial_executor()) {
    inputs_.resize(node_->inputs().size());
    outputs_.resize(node_->outputs().size());
  }

  OneNode& set(const std::string& param, const knead::Literal& value) {
    for (knead::ParamBase* p : node_->params())
      if (p->name() == param) {
        const std::string wrong = p->assign(value);
        if (!wrong.empty()) throw std::runtime_error(param + ": " + wrong);
        return *this;
      }
    throw std::runtime_error("no parameter " + param);
  }
  template <class T>
  OneNode& connect(const std::string& port, T value) {
    for (size_t k = 0; k < inputs_.size(); ++k)
      if (node_->inputs()[k].name == port) {
        if (!node_->inputs()[k].many) inputs_[k].clear();
        inputs_[k].push_back(knead::Value::of(std::move(value)));
        return *this;
      }
    throw std::runtime_error("no input " + port);
  }
  OneNode& run() {
    warnings.clear();
    node_->configure();
    node_->evaluate(*this);
    return *this;
  }
  template <class T>
  const T& out(const std::string& port) const {
    for (size_t k = 0; k < outputs_.size(); ++k)
      if (node_->outputs()[k].name == port) return outputs_[k].as<T>();
    throw std::runtime_error("no output " + port);
  }
  const knead::Node& node() const { return *node_; }
  std::string all_warnings() const {
    std::string text;
    for (const std::string& w : warnings) text += w + "\n";
    return text;
  }

  std::vector<std::string> warnings;
  int builds = 0;  // times that `once` had to make something

  int frame() const override { return 1; }
  knead::Executor& executor() const override { return *executor_; }
  bool cancelled() const override { return false; }
  void warn(const std::string& message) override { warnings.push_back(message); }
  knead::Value once(const knead::Key& key, knead::FunctionRef<knead::Value()> make) override {
    auto found = made_.find(key);
    if (found == made_.end()) ++builds, found = made_.emplace(key, make()).first;
    return found->second;
  }
  const knead::Value& input(int port, size_t i) const override { return inputs_.at(port).at(i); }
  size_t input_count(int port) const override { return inputs_.at(port).size(); }
  void set_output(int port, knead::Value value) override { outputs_.at(port) = std::move(value); }
  void add_time(const std::string&, double) override {}

 private:
  std::unique_ptr<knead::Node> node_;
  std::unique_ptr<knead::Executor> executor_;
  std::vector<std::vector<knead::Value>> inputs_;
  std::vector<knead::Value> outputs_;
  std::map<knead::Key, knead::Value> made_;
};

// The field's interpolant, world units.
inline double value_at(const knead::Sdf& sdf, const knead::Vec3d& world) {
  const knead::Vec3d local = sdf.placement.inverse().apply(world);
  const float far = 1e9f;
  const auto* grid = reinterpret_cast<const nanovdb::NanoGrid<float>*>(sdf.grid.host().data());
  knead::SdfSampler sampler(knead::SdfView{grid, {-far, -far, -far}, {far, far, far}});
  return sampler.value(knead::to_float((local - to_double(sdf.index_origin)) * (1.0 / sdf.voxel_size))) * sdf.placement.scale;
}

}  // namespace sdf_node_test
