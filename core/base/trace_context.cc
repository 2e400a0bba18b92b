#include "core/base/trace_context.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <random>

#include "absl/strings/str_cat.h"

namespace isoscope::base {
namespace {

constexpr std::size_t kTraceIdDigits = 32;
constexpr std::size_t kParentIdDigits = 16;
constexpr std::size_t kTraceparentBytes = 2 + 1 + kTraceIdDigits + 1 + kParentIdDigits + 1 + 2;

// Returns 64 random bits, never 0. One generator a thread: the system is asked once for its seed.
std::uint64_t RandomBits() {
  thread_local std::mt19937_64 generator = [] {
    std::random_device device;
    std::seed_seq seed{device(), device(), device(), device(),
                       device(), device(), device(), device()};
    return std::mt19937_64(seed);
  }();
  std::uint64_t bits = 0;
  while (bits == 0) {
    bits = generator();
  }
  return bits;
}

std::string Hex(std::uint64_t bits) { return absl::StrCat(absl::Hex(bits, absl::kZeroPad16)); }

bool IsLowerHex(absl::string_view text) {
  return std::all_of(text.begin(), text.end(),
                     [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

bool IsZero(absl::string_view text) {
  return text.find_first_not_of('0') == absl::string_view::npos;
}

int HexValue(char digit) { return digit <= '9' ? digit - '0' : digit - 'a' + 10; }

}  // namespace

TraceContext TraceContext::Random() {
  return {absl::StrCat(Hex(RandomBits()), Hex(RandomBits())), /*is_sampled=*/false};
}

std::optional<TraceContext> TraceContext::Parse(absl::string_view traceparent) {
  if (traceparent.size() < kTraceparentBytes) {
    return std::nullopt;
  }
  const absl::string_view version = traceparent.substr(0, 2);
  const absl::string_view trace_id = traceparent.substr(3, kTraceIdDigits);
  const absl::string_view parent_id = traceparent.substr(4 + kTraceIdDigits, kParentIdDigits);
  const absl::string_view flags = traceparent.substr(kTraceparentBytes - 2, 2);
  const bool has_dashes = traceparent[2] == '-' && traceparent[3 + kTraceIdDigits] == '-' &&
                          traceparent[kTraceparentBytes - 3] == '-';
  if (!has_dashes || !IsLowerHex(version) || version == "ff" || !IsLowerHex(trace_id) ||
      !IsLowerHex(parent_id) || !IsLowerHex(flags) || IsZero(trace_id) || IsZero(parent_id)) {
    return std::nullopt;
  }
  // A later version may say more, behind a dash.
  if (traceparent.size() > kTraceparentBytes &&
      (version == "00" || traceparent[kTraceparentBytes] != '-')) {
    return std::nullopt;
  }
  return TraceContext(std::string(trace_id), (HexValue(flags[1]) & 1) != 0);
}

TraceContext TraceContext::ParseOrRandom(absl::string_view traceparent) {
  std::optional<TraceContext> parsed = Parse(traceparent);
  return parsed.has_value() ? *std::move(parsed) : Random();
}

std::string TraceContext::MakeTraceparent() const {
  return absl::StrCat("00-", trace_id_, "-", Hex(RandomBits()), is_sampled_ ? "-01" : "-00");
}

}  // namespace isoscope::base
