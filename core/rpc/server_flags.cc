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
  app->add_option_function<std::string>(
         "--reflection",
         [flags](const std::string& value) { flags->has_reflection = value == "on"; },
         "Whether anybody may ask which services there are")
      ->check(CLI::IsMember({"on", "off"}))
      ->type_name("on|off")
      ->envname("ISOSCOPE_REFLECTION")
      ->default_str("on");
}

}  // namespace

void AddTransportFlags(CLI::App* app, TransportFlags* flags, bool has_server_name) {
  app->add_option("--tls-cert", flags->certificate_file,
                  "Own certificate and its chain, PEM; read again when it changes")
      ->type_name("FILE")
      ->envname("ISOSCOPE_TLS_CERT");
  app->add_option("--tls-key", flags->key_file, "Its private key, PEM")
      ->type_name("FILE")
      ->envname("ISOSCOPE_TLS_KEY");
  app->add_option("--tls-ca", flags->ca_file,
                  "The authority that must have signed the certificates of all others, PEM")
      ->type_name("FILE")
      ->envname("ISOSCOPE_TLS_CA");
  if (has_server_name) {
    app->add_option("--tls-server-name", flags->server_name,
                    "The name that the certificates of dialled servers must bear, where it is not "
                    "that of their address")
        ->type_name("NAME")
        ->envname("ISOSCOPE_TLS_SERVER_NAME");
  }
  app->add_flag("--insecure", flags->is_insecure,
                "Allow plaintext beyond this machine: for private networks only")
      ->envname("ISOSCOPE_INSECURE");
}

void AddServerFlags(CLI::App* app, ServerFlags* flags, bool is_grpc_server, bool dials) {
  constexpr double kMaxDrainSeconds = 86400;
  app->add_option("--listen", flags->listen_address, "Address to serve on; port 0 takes a free one")
      ->type_name("HOST:PORT")
      ->envname("ISOSCOPE_LISTEN")
      ->capture_default_str();
  if (is_grpc_server) {
    AddFrameFlags(app, flags);
  }
  AddTransportFlags(app, &flags->transport, /*has_server_name=*/dials);
  app->add_option("--drain-seconds", flags->drain_seconds,
                  "How long calls in work may take to end at shutdown")
      ->check(CLI::Range(0.0, kMaxDrainSeconds))
      ->envname("ISOSCOPE_DRAIN_SECONDS")
      ->capture_default_str();
  app->add_option("--log-level", flags->log_level, "Lines below it are dropped")
      ->check(CLI::IsMember({"debug", "info", "warning", "error", "off"}))
      ->envname("ISOSCOPE_LOG_LEVEL")
      ->capture_default_str();
  app->add_option_function<std::string>(
         "--probe",
         [flags](const std::string& address) {
           flags->is_probe = true;
           flags->probe_address = address == "true" ? "" : address;  // CLI11's word for no value
         },
         "Ask the server there, by default the one on --listen, whether it serves; exit with 0 if "
         "it does, else with 1")
      ->type_name("[HOST:PORT]")
      ->expected(0, 1);
}

std::string BoundAddress(absl::string_view listen_address, int port) {
  const absl::string_view::size_type colon = listen_address.rfind(':');
  return absl::StrCat(listen_address.substr(0, colon), ":", port);
}

}  // namespace isoscope::rpc
