// One error type for the whole library. Throw it for contract, configuration, file and device failures; quality is returned as numbers in a Report.
#pragma once
#include <exception>
#include <string>
#include <vector>

#include "graph/api.h"

namespace knead {

enum class ErrorCode { kGraph, kInput, kFile, kMemory, kDevice, kCancelled, kInternal };

KNEAD_API const char* name_of(ErrorCode code);

// A place in a graph file or in a data file. Empty or zero members are unknown and are left out of the text.
struct KNEAD_API Where {
  std::string file;
  int line = 0;    // from 1
  int column = 0;  // from 1
  std::string node;
  std::string member;  // port or parameter of the node

  std::string text() const;  // "press.yaml:14:9, node 'push', 'margin'"
};

class KNEAD_API Error : public std::exception {
 public:
  Error(ErrorCode code, Where where, std::string message, std::string hint = {});
  Error(ErrorCode code, std::string message, std::string hint = {});

  const char* what() const noexcept override { return text_.c_str(); }
  ErrorCode code() const { return code_; }
  const Where& where() const { return where_; }
  const std::string& message() const { return message_; }
  const std::string& hint() const { return hint_; }
  Error at(const Where& outer) const;  // fills in what `where()` does not know yet

 private:
  ErrorCode code_;
  Where where_;
  std::string message_, hint_, text_;
};

// Every error of a graph at once. what() is all of them, one per line.
class KNEAD_API GraphErrors : public Error {
 public:
  explicit GraphErrors(std::vector<Error> errors);
  const std::vector<Error>& errors() const { return errors_; }

 private:
  std::vector<Error> errors_;
};

// The exception being handled, as an Error of this place. Call it in a catch block.
KNEAD_API Error error_in_flight(const Where& where = {});

// The candidate nearest to `wrong` by edit distance, or "" when nothing is near enough to be a likely slip.
KNEAD_API std::string nearest_name(const std::string& wrong, const std::vector<std::string>& candidates);

}  // namespace knead
