#include "kernels/parallel.h"

namespace knead {

Executor& stand_in() {
  static const std::unique_ptr<Executor> serial = make_serial_executor();
  return *serial;
}

}  // namespace knead
