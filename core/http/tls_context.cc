#include "core/http/tls_context.h"

#include "absl/strings/str_cat.h"
#include <boost/asio/ssl/context.hpp>
#include <sys/stat.h>

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"

namespace isoscope::http {

namespace ssl = boost::asio::ssl;
using boost::system::error_code;

absl::StatusOr<std::unique_ptr<TlsContext>> TlsContext::Make(const std::string& certificate_file,
                                                             const std::string& key_file) {
  std::unique_ptr<TlsContext> made(new TlsContext(certificate_file, key_file));
  made->state_ = made->StateOfFiles();
  made->looked_ = base::MonotonicNow();
  ISOSCOPE_RETURN_IF_ERROR(made->Load());
  return made;
}

std::string TlsContext::StateOfFiles() const {
  std::string state;
  for (const std::string* path : {&certificate_file_, &key_file_}) {
    struct stat found {};
    if (stat(path->c_str(), &found) == 0) {
      absl::StrAppend(&state, found.st_ino, ",", found.st_size, ",", found.st_mtim.tv_sec, ".",
                      found.st_mtim.tv_nsec, ";");
    }
  }
  return state;
}

absl::Status TlsContext::Load() {
  auto context = std::make_shared<ssl::context>(ssl::context::tls_server);
  error_code error;
  context->set_options(ssl::context::default_workarounds | ssl::context::no_sslv2 |
                           ssl::context::no_sslv3 | ssl::context::no_tlsv1 |
                           ssl::context::no_tlsv1_1,
                       error);
  for (const std::string& file : {certificate_file_, key_file_}) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(file));  // OpenSSL would wait for a writer
  }
  std::string failed_file;
  if (!error) {
    context->use_certificate_chain_file(certificate_file_, error);
    failed_file = certificate_file_;
  }
  if (!error) {
    // Checks that the key belongs to the certificate.
    context->use_private_key_file(key_file_, ssl::context::pem, error);
    failed_file = key_file_;
  }
  if (error) {
    return absl::InvalidArgumentError(
        absl::StrCat(failed_file, ": can't be used for https: ", error.message()));
  }
  context_ = std::move(context);
  return absl::OkStatus();
}

std::shared_ptr<ssl::context> TlsContext::Get(base::MonotonicTime now) {
  if (now - looked_ >= kReloadInterval) {
    looked_ = now;
    std::string state = StateOfFiles();
    if (state != state_) {
      state_ = std::move(state);
      const absl::Status status = Load();
      if (status.ok()) {
        base::LogInfo("certificate_read", {{"file", base::OwnText{certificate_file_}}});
      } else {
        base::LogWarning("certificate_not_read", {{"status", status}});
      }
    }
  }
  return context_;
}

}  // namespace isoscope::http
