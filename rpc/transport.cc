// Credentials in four steps:
//
// 1. CheckListen and CheckDial refuse flags that would send plaintext beyond this machine.
// 2. CheckFiles reads the files once: certificate, key, validity, role. So errors appear at the
//    start, with the name of the file, and not as a failed handshake.
// 3. gRPC gets a FileWatcherCertificateProvider, which reads the files again when they change.
// 4. Roles are checked for each connection or call. A server refuses calls by RoleGate, except
//    those for health. A client refuses servers by ServerRoleVerifier, in the handshake.
//
// So a program need not restart when certificates are renewed.

#include "rpc/transport.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <ctime>
#include <functional>
#include <map>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <arpa/inet.h>
#include <grpcpp/security/auth_metadata_processor.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/security/server_credentials.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_certificate_verifier.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <netinet/in.h>
#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "rpc/peer.h"

namespace isoscope::rpc {
namespace {

// The time after which a changed file is read again.
constexpr unsigned kReloadSeconds = 1;
constexpr std::int64_t kMaxFileBytes = base::kMiB;

template <typename T, void (*Free)(T*)>
struct Deleter {
  void operator()(T* object) const { Free(object); }
};
using X509Ptr = std::unique_ptr<X509, Deleter<X509, X509_free>>;
using KeyPtr = std::unique_ptr<EVP_PKEY, Deleter<EVP_PKEY, EVP_PKEY_free>>;
using BioPtr = std::unique_ptr<BIO, Deleter<BIO, BIO_free_all>>;
using NamesPtr = std::unique_ptr<GENERAL_NAMES, Deleter<GENERAL_NAMES, GENERAL_NAMES_free>>;

bool IsLoopbackHost(absl::string_view host) {
  absl::ConsumePrefix(&host, "[");
  absl::ConsumeSuffix(&host, "]");
  const std::string text(host);
  in_addr v4{};
  if (inet_pton(AF_INET, text.c_str(), &v4) == 1) {
    return (ntohl(v4.s_addr) >> 24U) == 127;
  }
  in6_addr v6{};
  if (inet_pton(AF_INET6, text.c_str(), &v6) == 1) {
    return IN6_IS_ADDR_LOOPBACK(&v6);
  }
  return absl::EqualsIgnoreCase(host, "localhost") || absl::EndsWithIgnoreCase(host, ".localhost");
}

// "host:port", "[::1]:port" or "host" without the port.
absl::string_view HostOf(absl::string_view address) {
  const std::size_t colon = address.rfind(':');
  const bool has_port = colon != absl::string_view::npos &&
                        (absl::StartsWith(address, "[") ? absl::StrContains(address, "]:")
                                                        : address.find(':') == colon);
  return has_port ? address.substr(0, colon) : address;
}

absl::StatusOr<std::string> ReadPem(absl::string_view flag, const std::string& path) {
  absl::StatusOr<std::string> text = io::ReadWholeFile(path, kMaxFileBytes);
  if (!text.ok()) {
    return absl::Status(text.status().code(), absl::StrCat(flag, ": ", text.status().message()));
  }
  return text;
}

// The first certificate of a PEM file. INVALID_ARGUMENT if there is none.
absl::StatusOr<X509Ptr> ReadCertificate(absl::string_view flag, const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, ReadPem(flag, path));
  const BioPtr bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
  X509Ptr certificate(PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr));
  if (certificate == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat(flag, ": ", path,
                     " holds no certificate in PEM form (-----BEGIN CERTIFICATE-----); "
                     "scripts/make_certificates.sh makes all that is needed"));
  }
  return certificate;
}

// Never asks for a pass phrase, because a daemon has no terminal.
int NoPassPhrase(char* /*buffer*/, int /*size*/, int /*is_writing*/, void* /*user*/) { return -1; }

absl::Status CheckKey(const TransportFlags& flags, const X509& certificate) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, ReadPem("--tls-key", flags.key_file));
  const BioPtr bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
  const KeyPtr key(PEM_read_bio_PrivateKey(bio.get(), nullptr, NoPassPhrase, nullptr));
  if (key == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat("--tls-key: ", flags.key_file, " holds no private key without pass phrase"));
  }
  if (X509_check_private_key(&certificate, key.get()) != 1) {
    return absl::InvalidArgumentError(absl::StrCat("--tls-key: the key in ", flags.key_file,
                                                   " is not that of the certificate in ",
                                                   flags.certificate_file));
  }
  return absl::OkStatus();
}

std::string FormatTime(const ASN1_TIME* time) {
  std::tm parts{};
  return ASN1_TIME_to_tm(time, &parts) == 1
             ? absl::FormatTime("%Y-%m-%d %H:%M:%S UTC", absl::FromTM(parts, absl::UTCTimeZone()),
                                absl::UTCTimeZone())
             : "an unreadable time";
}

absl::Status CheckValidity(const std::string& path, const X509& certificate) {
  std::time_t now = absl::ToTimeT(absl::Now());
  if (X509_cmp_time(X509_get0_notAfter(&certificate), &now) < 0) {
    return absl::FailedPreconditionError(
        absl::StrCat("--tls-cert: the certificate in ", path, " expired on ",
                     FormatTime(X509_get0_notAfter(&certificate)), ": sign a new one"));
  }
  if (X509_cmp_time(X509_get0_notBefore(&certificate), &now) > 0) {
    return absl::FailedPreconditionError(absl::StrCat(
        "--tls-cert: the certificate in ", path, " is valid from ",
        FormatTime(X509_get0_notBefore(&certificate)), " on: check the clock of this machine"));
  }
  return absl::OkStatus();
}

// The alternative names of one kind: GEN_DNS or GEN_URI.
std::vector<std::string> NamesOf(const X509& certificate, int kind) {
  std::vector<std::string> found;
  const NamesPtr names(static_cast<GENERAL_NAMES*>(
      X509_get_ext_d2i(&certificate, NID_subject_alt_name, nullptr, nullptr)));
  const int count = names == nullptr ? 0 : sk_GENERAL_NAME_num(names.get());
  for (int i = 0; i < count; ++i) {
    const GENERAL_NAME* const name = sk_GENERAL_NAME_value(names.get(), i);
    if (name->type == kind) {
      const ASN1_IA5STRING* const text =
          kind == GEN_DNS ? name->d.dNSName : name->d.uniformResourceIdentifier;
      found.emplace_back(reinterpret_cast<const char*>(ASN1_STRING_get0_data(text)),
                         static_cast<std::size_t>(ASN1_STRING_length(text)));
    }
  }
  return found;
}

absl::Status CheckRole(const std::string& path, const X509& certificate,
                       absl::string_view own_role) {
  std::vector<std::string> roles = RolesOf(NamesOf(certificate, GEN_URI));
  for (const std::string& role : roles) {
    if (role == own_role) {
      return absl::OkStatus();
    }
  }
  return absl::FailedPreconditionError(absl::StrCat(
      "--tls-cert: the certificate in ", path, " has ",
      roles.empty() ? "no role" : absl::StrCat("the role ", absl::StrJoin(roles, ", ")),
      ": this program needs one with the alternative name URI:", kRolePrefix, own_role));
}

// Refuses calls of peers without the role.
class RoleGate final : public grpc::AuthMetadataProcessor {
 public:
  explicit RoleGate(absl::string_view role) : role_(role) {}

  [[nodiscard]] bool IsBlocking() const override { return false; }

  grpc::Status Process(const InputMetadata& metadata, grpc::AuthContext* context,
                       OutputMetadata* /*consumed*/, OutputMetadata* /*response*/) override {
    const auto path = metadata.find(":path");
    constexpr absl::string_view kHealth = "/grpc.health.v1.Health/";
    if (path != metadata.end() &&
        absl::StartsWith(absl::string_view(path->second.data(), path->second.size()), kHealth)) {
      return grpc::Status::OK;
    }
    const Peer peer = PeerOf(*context);
    if (peer.HasRole(role_)) {
      return grpc::Status::OK;
    }
    return {grpc::StatusCode::PERMISSION_DENIED,
            absl::StrCat("only a ", role_, " may call this; ", Describe(peer))};
  }

 private:
  const std::string role_;
};

// Refuses servers without the role, and those whose certificate bears another name than the dialled
// one.
class ServerRoleVerifier final : public grpc::experimental::ExternalCertificateVerifier {
 public:
  using Request = grpc::experimental::TlsCustomVerificationCheckRequest;

  explicit ServerRoleVerifier(absl::string_view role) : role_(role) {}

  // Decides at once.
  bool Verify(Request* request, std::function<void(grpc::Status)> /*callback*/,
              grpc::Status* status) override {
    const bool is_decided = name_verifier_.Verify(
        request, [](const grpc::Status&) {}, status);
    if (!is_decided) {
      *status = {grpc::StatusCode::INTERNAL, "the check of the name would take time"};
    }
    if (!status->ok()) {
      return true;
    }
    std::vector<std::string> uris;
    for (const grpc::string_ref& uri : request->uri_names()) {
      uris.emplace_back(uri.data(), uri.size());
    }
    const std::vector<std::string> roles = RolesOf(uris);
    if (std::find(roles.begin(), roles.end(), role_) == roles.end()) {
      *status = {grpc::StatusCode::PERMISSION_DENIED,
                 absl::StrCat("the server's certificate must have the role ", role_, ", and has ",
                              roles.empty() ? "none" : absl::StrJoin(roles, ", "))};
    }
    return true;
  }

  void Cancel(Request* /*request*/) override {}

 private:
  const std::string role_;
  grpc::experimental::HostNameCertificateVerifier name_verifier_;
};

std::shared_ptr<grpc::experimental::FileWatcherCertificateProvider> WatchFiles(
    const TransportFlags& flags) {
  return std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
      flags.key_file, flags.certificate_file, flags.ca_file, kReloadSeconds);
}

}  // namespace

bool IsLoopbackTarget(absl::string_view target) {
  if (absl::StartsWith(target, "unix:") || absl::StartsWith(target, "unix-abstract:")) {
    return true;
  }
  bool may_be_list = false;
  if (absl::ConsumePrefix(&target, "dns:")) {
    // "dns:name", "dns:///name" or "dns://server/name".
    target = target.substr(absl::StartsWith(target, "//") ? target.rfind('/') + 1 : 0);
  } else if (absl::ConsumePrefix(&target, "ipv4:") || absl::ConsumePrefix(&target, "ipv6:")) {
    may_be_list = true;
  }
  const std::vector<absl::string_view> addresses =
      may_be_list ? absl::StrSplit(target, ',') : std::vector<absl::string_view>{target};
  for (const absl::string_view address : addresses) {
    if (!IsLoopbackHost(HostOf(address))) {
      return false;
    }
  }
  return true;
}

absl::Status CheckListen(const TransportFlags& flags, absl::string_view listen_address) {
  if (flags.has_tls() || !flags.key_file.empty()) {
    if (flags.certificate_file.empty() || flags.key_file.empty() || flags.ca_file.empty()) {
      return absl::InvalidArgumentError(
          "--tls-cert, --tls-key and --tls-ca belong together: give all three");
    }
    return absl::OkStatus();
  }
  if (listen_address.empty() || flags.is_insecure || IsLoopbackTarget(listen_address)) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(absl::StrCat(
      "--listen ", listen_address,
      " leaves this machine, and would be plaintext that anybody may use: give --tls-cert, "
      "--tls-key and --tls-ca (scripts/make_certificates.sh makes them), or say --insecure where "
      "the network is private"));
}

absl::Status CheckDialFlags(const TransportFlags& flags) {
  if (flags.certificate_file.empty() != flags.key_file.empty()) {
    return absl::InvalidArgumentError(
        "--tls-cert and --tls-key belong together: give both or neither");
  }
  if (!flags.certificate_file.empty() && flags.ca_file.empty()) {
    return absl::InvalidArgumentError(
        "--tls-ca is missing: the certificate of the authority that signed the server's");
  }
  if (!flags.server_name.empty() && !flags.has_tls()) {
    return absl::InvalidArgumentError("--tls-server-name is for TLS: give --tls-ca, too");
  }
  return absl::OkStatus();
}

absl::Status CheckDial(const TransportFlags& flags, absl::string_view peer,
                       absl::string_view target) {
  ISOSCOPE_RETURN_IF_ERROR(CheckDialFlags(flags));
  if (flags.has_tls() || flags.is_insecure || IsLoopbackTarget(target)) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat(peer, " ", target,
                   " is not on this machine, and would be dialled in plaintext: give --tls-cert, "
                   "--tls-key and --tls-ca, or say --insecure where the network is private"));
}

absl::Status CheckFiles(const TransportFlags& flags, absl::string_view own_role) {
  if (!flags.ca_file.empty()) {
    ISOSCOPE_RETURN_IF_ERROR(ReadCertificate("--tls-ca", flags.ca_file).status());
  }
  if (flags.certificate_file.empty()) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const X509Ptr certificate,
                            ReadCertificate("--tls-cert", flags.certificate_file));
  ISOSCOPE_RETURN_IF_ERROR(CheckKey(flags, *certificate));
  ISOSCOPE_RETURN_IF_ERROR(CheckValidity(flags.certificate_file, *certificate));
  return own_role.empty() ? absl::OkStatus()
                          : CheckRole(flags.certificate_file, *certificate, own_role);
}

std::string FirstNameOf(const std::string& certificate_file) {
  const absl::StatusOr<X509Ptr> certificate = ReadCertificate("--tls-cert", certificate_file);
  const std::vector<std::string> names =
      certificate.ok() ? NamesOf(**certificate, GEN_DNS) : std::vector<std::string>();
  return names.empty() ? "" : names.front();
}

absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> MakeServerCredentials(
    const TransportFlags& flags, absl::string_view own_role, PeerCertificate peer_certificate,
    absl::string_view required_role) {
  if (!flags.has_tls()) {
    return nullptr;
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckFiles(flags, own_role));
  grpc::experimental::TlsServerCredentialsOptions options(WatchFiles(flags));
  options.watch_root_certs();
  options.watch_identity_key_cert_pairs();
  options.set_cert_request_type(peer_certificate == PeerCertificate::kRequired
                                    ? GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY
                                    : GRPC_SSL_REQUEST_CLIENT_CERTIFICATE_AND_VERIFY);
  std::shared_ptr<grpc::ServerCredentials> credentials =
      grpc::experimental::TlsServerCredentials(options);
  if (!required_role.empty()) {
    credentials->SetAuthMetadataProcessor(std::make_shared<RoleGate>(required_role));
  }
  return credentials;
}

absl::StatusOr<Dialing> MakeDialing(const TransportFlags& flags, absl::string_view own_role,
                                    absl::string_view server_role) {
  if (!flags.has_tls()) {
    return Dialing();
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckFiles(flags, own_role));
  grpc::experimental::TlsChannelCredentialsOptions options;
  options.set_certificate_provider(WatchFiles(flags));
  options.watch_root_certs();
  if (!flags.certificate_file.empty()) {
    options.watch_identity_key_cert_pairs();
  }
  if (!server_role.empty()) {
    options.set_certificate_verifier(
        grpc::experimental::ExternalCertificateVerifier::Create<ServerRoleVerifier>(server_role));
  }
  return Dialing{.credentials = grpc::experimental::TlsCredentials(options),
                 .server_name = flags.server_name};
}

}  // namespace isoscope::rpc
