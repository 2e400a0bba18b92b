// What tests of addresses share: an object, options with short waits, and a reading of all.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_SOURCE_REMOTE_REMOTE_TEST_H_
#define ISOSCOPE_TESTS_UNIT_CORE_SOURCE_REMOTE_REMOTE_TEST_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/random.h"
#include "core/source/bytes/byte_source.h"
#include "core/source/remote/open_address.h"
#include "core/source/remote/remote_options.h"

namespace isoscope::source {

inline std::string RemoteBytes(std::size_t size) {
  std::string bytes(size, '\0');
  for (std::size_t i = 0; i < size; ++i) {
    bytes[i] = static_cast<char>(base::RandomBits(7, i));
  }
  return bytes;
}

// No proxy, no credentials; waits that a test can wait for, but a slow machine does not reach.
inline RemoteOptions QuickOptions() {
  RemoteOptions options;
  options.proxy = "";
  options.retry.first_delay = absl::Milliseconds(1);
  options.retry.max_delay = absl::Milliseconds(4);
  options.connect_timeout = absl::Seconds(20);
  options.head_timeout = absl::Seconds(60);
  options.stall_timeout = absl::Seconds(60);
  return options;
}

// Opens the address and reads all of it.
inline absl::StatusOr<std::string> ReadAddress(const std::string& address,
                                               const RemoteOptions& options) {
  const base::Cancellation never;
  const auto source = OpenAddress(address, options, never);
  if (!source.ok()) {
    return source.status();
  }
  std::string bytes(static_cast<std::size_t>((*source)->size_bytes()), '?');
  const absl::Status status = (*source)->ReadAt(0, bytes.size(), bytes.data(), never);
  if (!status.ok()) {
    return status;
  }
  return bytes;
}

}  // namespace isoscope::source

#endif  // ISOSCOPE_TESTS_UNIT_CORE_SOURCE_REMOTE_REMOTE_TEST_H_
