#include "core/rpc/server_flags.h"

#include "absl/strings/str_cat.h"

namespace isoscope::rpc {

namespace {

void AddFrameFlags(CLI::App* app, ServerFlags* flags) {
  app->add_option("--max-concurrent-frames", flags->max_concurrent_frames,
                  "Frames that may be in work at a time")
      ->check(CLI::Range(1, 1024))
      ->envname("ISOSCOPE_MAX_CONCURRENT_FRAMES")
      ->capture_default_str();
  app->add_option("--max-queued-frames", flags->max_queued_frames,
                  "Frames that may wait; more are refused")
      ->check(CLI::Range(0, 1 << 20))
      ->envname("ISOSCOPE_MAX_QUEUED_FRAMES")
      ->capture_default_str();
}

}  // namespace

void AddServerFlags(CLI::App* app, ServerFlags* flags, bool has_frame_flags) {
  constexpr double kMaxDrainSeconds = 86400;
  app->add_option("--listen", flags->listen_address, "Address to serve on; port 0 takes a free one")
      ->type_name("HOST:PORT")
      ->envname("ISOSCOPE_LISTEN")
      ->capture_default_str();
  if (has_frame_flags) {
    AddFrameFlags(app, flags);
  }
  app->add_option("--drain-seconds", flags->drain_seconds,
                  "How long calls in work may take to end at shutdown")
      ->check(CLI::Range(0.0, kMaxDrainSeconds))
      ->envname("ISOSCOPE_DRAIN_SECONDS")
      ->capture_default_str();
  app->add_option("--metrics-listen", flags->metrics_listen,
                  "Serve metrics to Prometheus at http://HOST:PORT/metrics; a port alone: on "
                  "loopback")
      ->type_name("HOST:PORT")
      ->envname("ISOSCOPE_METRICS_LISTEN");
  app->add_option("--log-level", flags->log_level, "Lines below it are dropped")
      ->check(CLI::IsMember({"debug", "info", "warning", "error", "off"}))
      ->envname("ISOSCOPE_LOG_LEVEL")
      ->capture_default_str();
}

std::string BoundAddress(absl::string_view listen_address, int port) {
  const absl::string_view::size_type colon = listen_address.rfind(':');
  return absl::StrCat(listen_address.substr(0, colon), ":", port);
}

}  // namespace isoscope::rpc
