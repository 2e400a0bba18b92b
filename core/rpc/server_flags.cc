#include "core/rpc/server_flags.h"

#include <cstdlib>

#include "absl/strings/str_cat.h"

#include "core/base/log.h"

namespace isoscope::rpc {

void AddServerFlags(CLI::App* app, double* drain_seconds, std::string* log_level) {
  constexpr double kMaxDrainSeconds = 86400;
  app->add_option("--drain-seconds", *drain_seconds,
                  "How long calls in work may take to end at shutdown")
      ->check(CLI::Range(0.0, kMaxDrainSeconds))
      ->envname("ISOSCOPE_DRAIN_SECONDS")
      ->capture_default_str();
  app->add_option("--log-level", *log_level, "Lines below it are dropped")
      ->check(CLI::IsMember({"debug", "info", "warning", "error", "off"}))
      ->envname("ISOSCOPE_LOG_LEVEL")
      ->capture_default_str();
}

void SilenceGrpcLog() {
  constexpr int kKeepExisting = 0;
  // NOLINTNEXTLINE(concurrency-mt-unsafe): no other thread runs yet.
  setenv("GRPC_VERBOSITY", "NONE", kKeepExisting);
}

void ApplyLogLevel(absl::string_view name) {
  if (name == "debug") {
    base::SetLogLevel(base::LogLevel::kDebug);
  } else if (name == "warning") {
    base::SetLogLevel(base::LogLevel::kWarning);
  } else if (name == "error") {
    base::SetLogLevel(base::LogLevel::kError);
  } else if (name == "off") {
    base::SetLogLevel(base::LogLevel::kOff);
  } else {
    base::SetLogLevel(base::LogLevel::kInfo);
  }
}

std::string BoundAddress(absl::string_view listen_address, int port) {
  const absl::string_view::size_type colon = listen_address.rfind(':');
  return absl::StrCat(listen_address.substr(0, colon), ":", port);
}

}  // namespace isoscope::rpc
