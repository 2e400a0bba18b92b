#include "tests/support/scripted_server.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdlib>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <sys/socket.h>

#include "core/base/check.h"

namespace isoscope::testing {

struct ScriptedServer::Tls {
  explicit Tls(const TestIdentity& identity) : context(SSL_CTX_new(TLS_server_method())) {
    BIO* const certificate_bio =
        BIO_new_mem_buf(identity.certificate.data(), static_cast<int>(identity.certificate.size()));
    X509* const certificate = PEM_read_bio_X509(certificate_bio, nullptr, nullptr, nullptr);
    BIO* const key_bio =
        BIO_new_mem_buf(identity.key.data(), static_cast<int>(identity.key.size()));
    EVP_PKEY* const key = PEM_read_bio_PrivateKey(key_bio, nullptr, nullptr, nullptr);
    ISOSCOPE_CHECK(SSL_CTX_use_certificate(context, certificate) == 1);
    ISOSCOPE_CHECK(SSL_CTX_use_PrivateKey(context, key) == 1);
    X509_free(certificate);
    EVP_PKEY_free(key);
    BIO_free(certificate_bio);
    BIO_free(key_bio);
  }
  ~Tls() { SSL_CTX_free(context); }
  Tls(const Tls&) = delete;
  Tls& operator=(const Tls&) = delete;

  SSL_CTX* const context;
};

// The descriptor stays open until the end, so that no other socket gets its number.
class ScriptedServer::Connection : public ServedConnection {
 public:
  Connection(int fd, SSL_CTX* tls) : fd_(fd), ssl_(tls == nullptr ? nullptr : SSL_new(tls)) {
    const int on = 1;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    if (ssl_ != nullptr) {
      SSL_set_fd(ssl_, fd);
    }
  }
  ~Connection() override {
    SSL_free(ssl_);
    close(fd_);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  bool Begin() { return ssl_ == nullptr || SSL_accept(ssl_) == 1; }
  bool Send(absl::string_view bytes) override {
    while (!bytes.empty() && !is_closed_) {
      const ssize_t sent = ssl_ == nullptr
                               ? ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL)
                               : SSL_write(ssl_, bytes.data(), static_cast<int>(bytes.size()));
      if (sent <= 0) {
        return false;
      }
      bytes.remove_prefix(static_cast<std::size_t>(sent));
    }
    return !is_closed_;
  }
  void Close() override {
    is_closed_ = true;
    shutdown(fd_, SHUT_RDWR);
  }
  void Reset() override {
    is_closed_ = true;
    // A connection to nowhere ends this one by RST.
    sockaddr unspecified{};
    unspecified.sa_family = AF_UNSPEC;
    connect(fd_, &unspecified, sizeof(unspecified));
  }
  void Hang() override {
    while (ReadMore()) {
    }
  }
  // A head with its empty line; none at the end.
  std::optional<std::string> ReadHead() {
    std::size_t end = std::string::npos;
    while ((end = unread_.find("\r\n\r\n")) == std::string::npos) {
      if (is_closed_ || !ReadMore()) {
        return std::nullopt;
      }
    }
    std::string head = unread_.substr(0, end + 2);
    unread_.erase(0, end + 4);
    return head;
  }

 private:
  bool ReadMore() {
    std::array<char, 4096> piece{};
    const ssize_t size = ssl_ == nullptr
                             ? ::recv(fd_, piece.data(), piece.size(), 0)
                             : SSL_read(ssl_, piece.data(), static_cast<int>(piece.size()));
    unread_.append(piece.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
    return size > 0;
  }

  const int fd_;
  SSL* const ssl_;
  std::atomic<bool> is_closed_{false};
  std::string unread_;
};

ScriptedServer::ScriptedServer(Script script, const TestIdentity* identity)
    : script_(std::move(script)),
      tls_(identity == nullptr ? nullptr : std::make_unique<Tls>(*identity)),
      listener_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof(address);
  ISOSCOPE_CHECK(bind(listener_, reinterpret_cast<sockaddr*>(&address), size) == 0);
  ISOSCOPE_CHECK(listen(listener_, SOMAXCONN) == 0);
  ISOSCOPE_CHECK(getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) == 0);
  port_ = ntohs(address.sin_port);
  accepting_ = std::thread([this] { Accept(); });
}

ScriptedServer::~ScriptedServer() {
  {
    const base::MutexLock lock(&mutex_);
    is_stopping_ = true;
    for (const auto& connection : connections_) {
      connection->Close();
    }
  }
  shutdown(listener_, SHUT_RDWR);
  accepting_.join();
  for (std::thread& thread : threads_) {
    thread.join();
  }
  close(listener_);
}

std::string ScriptedServer::origin() const {
  return absl::StrCat(tls_ == nullptr ? "http" : "https", "://127.0.0.1:", port_);
}

std::vector<ServedRequest> ScriptedServer::requests() const {
  const base::MutexLock lock(&mutex_);
  return requests_;
}

void ScriptedServer::Accept() {
  while (true) {
    const int fd = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    if (fd < 0) {
      return;
    }
    const auto connection =
        std::make_shared<Connection>(fd, tls_ == nullptr ? nullptr : tls_->context);
    ++connection_count_;
    {
      const base::MutexLock lock(&mutex_);
      if (is_stopping_) {
        return;
      }
      connections_.push_back(connection);
    }
    threads_.emplace_back([this, connection] { Serve(connection); });
  }
}

void ScriptedServer::Serve(const std::shared_ptr<Connection>& connection) {
  sigset_t pipe;  // of OpenSSL's writes
  sigemptyset(&pipe);
  sigaddset(&pipe, SIGPIPE);
  pthread_sigmask(SIG_BLOCK, &pipe, nullptr);
  if (connection->Begin()) {
    while (const auto head = connection->ReadHead()) {
      const std::vector<std::string> lines = absl::StrSplit(*head, "\r\n");
      const std::vector<std::string> words = absl::StrSplit(lines[0], ' ');
      ServedRequest request{.method = words[0], .target = words.size() > 1 ? words[1] : ""};
      for (std::size_t i = 1; i < lines.size(); ++i) {
        const std::size_t colon = lines[i].find(':');
        if (colon != std::string::npos) {
          request.headers[absl::AsciiStrToLower(lines[i].substr(0, colon))] =
              std::string(absl::StripAsciiWhitespace(lines[i].substr(colon + 1)));
        }
      }
      {
        const base::MutexLock lock(&mutex_);
        request.index = static_cast<int>(requests_.size());
        requests_.push_back(request);
      }
      script_(request, connection.get());
    }
  }
  connection->Close();
  const base::MutexLock lock(&mutex_);
  connections_.erase(std::remove(connections_.begin(), connections_.end(), connection),
                     connections_.end());
}

TestIdentity MakeTestIdentity() {
  EVP_PKEY* const key = EVP_EC_gen("P-256");
  X509* const certificate = X509_new();
  X509_set_version(certificate, 2);
  ASN1_INTEGER_set(X509_get_serialNumber(certificate), 1);
  X509_gmtime_adj(X509_getm_notBefore(certificate), -60 * 60);
  X509_gmtime_adj(X509_getm_notAfter(certificate), 60 * 60 * 24);
  X509_set_pubkey(certificate, key);
  X509_NAME* const name = X509_get_subject_name(certificate);
  X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC,
                             reinterpret_cast<const unsigned char*>("test"), -1, -1, 0);
  X509_set_issuer_name(certificate, name);
  X509_EXTENSION* const names =
      X509V3_EXT_conf_nid(nullptr, nullptr, NID_subject_alt_name, "IP:127.0.0.1");
  X509_add_ext(certificate, names, -1);
  X509_EXTENSION_free(names);
  X509_sign(certificate, key, EVP_sha256());
  const auto text_of = [](BIO* bio) {
    char* data = nullptr;
    const long size = BIO_get_mem_data(bio, &data);
    std::string text(data, static_cast<std::size_t>(size));
    BIO_free(bio);
    return text;
  };
  BIO* const certificate_bio = BIO_new(BIO_s_mem());
  PEM_write_bio_X509(certificate_bio, certificate);
  BIO* const key_bio = BIO_new(BIO_s_mem());
  PEM_write_bio_PrivateKey(key_bio, key, nullptr, nullptr, 0, nullptr, nullptr);
  X509_free(certificate);
  EVP_PKEY_free(key);
  return {.certificate = text_of(certificate_bio), .key = text_of(key_bio)};
}

std::pair<std::int64_t, std::int64_t> AskedRange(const ServedRequest& request, std::int64_t size) {
  const std::string header = request.Header("range");
  absl::string_view range = header;
  if (!absl::ConsumePrefix(&range, "bytes=")) {
    return {0, -1};
  }
  const std::size_t dash = range.find('-');
  std::int64_t first = 0;
  std::int64_t last = size - 1;
  const bool has_first = absl::SimpleAtoi(range.substr(0, dash), &first);
  const bool has_last = absl::SimpleAtoi(range.substr(dash + 1), &last);
  if (!has_first) {
    return size == 0 || last == 0 ? std::pair<std::int64_t, std::int64_t>(-1, -1)
                                  : std::pair(std::max<std::int64_t>(0, size - last), size - 1);
  }
  if (first >= size) {
    return {-1, -1};
  }
  return {first, has_last ? std::min(last, size - 1) : size - 1};
}

std::string Answer(int status, absl::string_view headers, absl::string_view body) {
  return absl::StrCat("HTTP/1.1 ", status, " X\r\n", headers, "Content-Length: ", body.size(),
                      "\r\n\r\n", body);
}

void ServeObject(const ServedObject& object, const ServedRequest& request,
                 ServedConnection* connection) {
  const auto size = static_cast<std::int64_t>(object.bytes.size());
  const std::string etag = object.etag.empty() ? "" : absl::StrCat("ETag: ", object.etag, "\r\n");
  const std::string if_match = request.Header("if-match");
  if (!if_match.empty() && if_match != object.etag) {
    connection->Send(Answer(412, etag, "changed"));
    return;
  }
  const auto [first, last] = AskedRange(request, size);
  if (first < 0) {
    connection->Send(Answer(416, absl::StrCat("Content-Range: bytes */", size, "\r\n"), ""));
  } else if (last < 0) {
    connection->Send(Answer(200, etag, object.bytes));
  } else {
    connection->Send(Answer(
        206, absl::StrCat(etag, "Content-Range: bytes ", first, "-", last, "/", size, "\r\n"),
        absl::string_view(object.bytes)
            .substr(static_cast<std::size_t>(first), static_cast<std::size_t>(last - first + 1))));
  }
}

}  // namespace isoscope::testing
