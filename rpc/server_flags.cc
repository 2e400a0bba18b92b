#include "rpc/server_flags.h"

#include <algorithm>

#include "absl/status/status.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "rpc/host_port.h"

namespace isoscope::rpc {

namespace {

void AddFrameFlags(cli::FlagSet* set, ServerFlags* flags) {
  set->AddInteger("--max-concurrent-frames", &flags->max_concurrent_frames, 1, 1024,
                  "Frames that may be in work at a time")
      .Environment("ISOSCOPE_MAX_CONCURRENT_FRAMES");
  set->AddInteger("--max-queued-frames", &flags->max_queued_frames, 0, 1 << 20,
                  "Frames that may wait; more are refused")
      .Environment("ISOSCOPE_MAX_QUEUED_FRAMES");
  const auto parse_reflection = [flags](absl::string_view text) {
    flags->has_reflection = text == "on";
    return text == "on" || text == "off"
               ? absl::OkStatus()
               : absl::InvalidArgumentError(absl::StrCat(text, " not in {on,off}"));
  };
  set->Add("--reflection", "on|off:{on,off}", parse_reflection,
           "Whether anybody may ask which services there are")
      .DefaultText("on")
      .Environment("ISOSCOPE_REFLECTION");
}

}  // namespace

void AddTransportFlags(cli::FlagSet* set, TransportFlags* flags, bool has_server_name) {
  set->AddText("--tls-cert", "FILE", &flags->certificate_file,
               "Own certificate and its chain, PEM; read again when it changes")
      .Environment("ISOSCOPE_TLS_CERT");
  set->AddText("--tls-key", "FILE", &flags->key_file, "Its private key, PEM")
      .Environment("ISOSCOPE_TLS_KEY");
  set->AddText("--tls-ca", "FILE", &flags->ca_file,
               "The authority that must have signed the certificates of all others, PEM")
      .Environment("ISOSCOPE_TLS_CA");
  if (has_server_name) {
    set->AddText("--tls-server-name", "NAME", &flags->server_name,
                 "The name that the certificates of dialled servers must bear, where it is not "
                 "that of their address")
        .Environment("ISOSCOPE_TLS_SERVER_NAME");
  }
  set->AddSwitch("--insecure", &flags->is_insecure,
                 "Allow plaintext beyond this machine: for private networks only")
      .Environment("ISOSCOPE_INSECURE");
}

void AddServerFlags(cli::FlagSet* set, ServerFlags* flags, bool is_grpc_server, bool dials) {
  constexpr double kMaxDrainSeconds = 86400;
  const auto parse_listen = [flags, usual = flags->listen_address](absl::string_view text) {
    int port = 0;
    ISOSCOPE_CHECK(absl::SimpleAtoi(usual.substr(usual.rfind(':') + 1), &port));
    flags->listen_address = WithDefaultPort(text, port);
    return absl::OkStatus();
  };
  set->Add("--listen", "HOST[:PORT]", parse_listen, "Address to serve on; port 0 takes a free one")
      .DefaultText(flags->listen_address)
      .Environment("ISOSCOPE_LISTEN");
  if (is_grpc_server) {
    AddFrameFlags(set, flags);
  }
  AddTransportFlags(set, &flags->transport, /*has_server_name=*/dials);
  set->AddNumber("--drain-seconds", &flags->drain_seconds, 0.0, kMaxDrainSeconds,
                 "How long calls in work may take to end at shutdown")
      .Environment("ISOSCOPE_DRAIN_SECONDS");
  set->AddText("--metrics-listen", "HOST:PORT", &flags->metrics_listen,
               "Serve metrics to Prometheus at http://HOST:PORT/metrics; a port alone: on "
               "loopback")
      .Environment("ISOSCOPE_METRICS_LISTEN");
  set->AddChoice("--log-level", &flags->log_level, {"debug", "info", "warning", "error", "off"},
                 "Lines below it are dropped")
      .Environment("ISOSCOPE_LOG_LEVEL");
  set->AddChoice("--log-format", &flags->log_format, {"text", "json"},
                 "Log lines for people, or one JSON object a line")
      .Environment("ISOSCOPE_LOG_FORMAT");
  const auto parse_probe = [flags](absl::string_view text) { return ParseProbe(text, flags); };
  set->AddOptional("--probe", "[ready|live][,HOST:PORT]", parse_probe,
                   "Ask the server there, by default the one on --listen, whether it is ready for "
                   "calls (default) or at least alive; exit with 0 if it is, else with 1");
}

absl::Status ParseProbe(absl::string_view text, ServerFlags* flags) {
  flags->is_probe = true;
  absl::string_view address = text;
  const absl::string_view first = text.substr(0, text.find(','));
  if (first == "ready" || first == "live") {
    flags->probe = first == "live" ? Probe::kLive : Probe::kReady;
    address.remove_prefix(std::min(first.size() + 1, text.size()));
    if (address.empty() && first.size() < text.size()) {
      return absl::InvalidArgumentError(absl::StrCat("'", text, "' has no HOST:PORT behind ','"));
    }
  }
  if (!address.empty() && address.find(':') == absl::string_view::npos) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is not ready, live, HOST:PORT, or one of the words,HOST:PORT"));
  }
  flags->probe_address = std::string(address);
  return absl::OkStatus();
}

std::string BoundAddress(absl::string_view listen_address, int port) {
  const absl::string_view::size_type colon = listen_address.rfind(':');
  return absl::StrCat(listen_address.substr(0, colon), ":", port);
}

}  // namespace isoscope::rpc
