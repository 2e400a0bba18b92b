#include "core/rpc/server_flags.h"

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

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
  set->AddText("--listen", "HOST:PORT", &flags->listen_address,
               "Address to serve on; port 0 takes a free one")
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
  const auto parse_probe = [flags](absl::string_view address) {
    flags->is_probe = true;
    flags->probe_address = std::string(address);
    return absl::OkStatus();
  };
  set->AddOptional("--probe", "[HOST:PORT]", parse_probe,
                   "Ask the server there, by default the one on --listen, whether it serves; exit "
                   "with 0 if it does, else with 1");
}

std::string BoundAddress(absl::string_view listen_address, int port) {
  const absl::string_view::size_type colon = listen_address.rfind(':');
  return absl::StrCat(listen_address.substr(0, colon), ":", port);
}

}  // namespace isoscope::rpc
