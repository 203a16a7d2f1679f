// How a search for a rest ended: that of the loop (graph/iterate.cpp) and of the equilibrium alike.
#pragma once

namespace knead {

enum class Ended {
  kAtRest,          // The stopping rule holds.
  kRounding,        // No step moves anything that float32 sees.
  kIterationLimit,  // All iterations that were allowed have been made.
  kStalled,         // No step leads to less energy.
  kNoContact,       // Nothing touches the body, which is as it was.
};

// Whether nothing that is left to do would be seen.
constexpr bool is_rest(Ended ended) {
  return ended == Ended::kAtRest || ended == Ended::kRounding || ended == Ended::kNoContact;
}

// As reports say it.
constexpr const char* text_of(Ended ended) {
  switch (ended) {
    case Ended::kAtRest: return "at rest";
    case Ended::kRounding: return "rounding";
    case Ended::kIterationLimit: return "iteration limit";
    case Ended::kStalled: return "stalled";
    case Ended::kNoContact: return "no contact";
  }
  return "";
}

}  // namespace knead
