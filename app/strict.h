// What --strict asks of every frame: "rest,warnings,penetration=1e-3".
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "app/verdict.h"

namespace knead::app {

constexpr const char* kStrictAlone = "rest,warnings";

// Whether a word of the command line may be the value of --strict.
bool is_strictness(const std::string& word);

class Strict {
 public:
  // "" asks for nothing. Throws UsageError.
  explicit Strict(const std::string& text);

  bool asks() const { return rest_ || warnings_ || !limits_.empty(); }

  // Why the frame is not good enough, a sentence each. Failed frames are judged elsewhere.
  std::vector<std::string> objections(const Verdict& verdict);

  // Limits on figures that no frame has told: they were never held against anything.
  std::vector<std::string> unknown_figures() const;

 private:
  struct Limit {
    std::string figure;
    double most = 0;  // of the absolute value
    bool told = false;
  };
  bool rest_ = false, warnings_ = false;
  std::vector<Limit> limits_;
};

}  // namespace knead::app
