#include "rpc/certificate_watch.h"

#include <ctime>
#include <limits>
#include <memory>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include <openssl/bio.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"

namespace isoscope::rpc {

absl::StatusOr<absl::Time> CertificateExpiry(const std::string& certificate_file) {
  constexpr std::int64_t kMaxFileBytes = base::kMiB;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text,
                            io::ReadWholeFile(certificate_file, kMaxFileBytes));
  const std::unique_ptr<BIO, int (*)(BIO*)> source(
      BIO_new_mem_buf(text.data(), static_cast<int>(text.size())), &BIO_free);
  const std::unique_ptr<X509, void (*)(X509*)> certificate(
      PEM_read_bio_X509(source.get(), nullptr, nullptr, nullptr), &X509_free);
  std::tm expiry{};
  if (certificate == nullptr ||
      ASN1_TIME_to_tm(X509_get0_notAfter(certificate.get()), &expiry) != 1) {
    return absl::InvalidArgumentError(
        absl::StrCat(certificate_file, ": no certificate in PEM (--tls-cert)"));
  }
  return absl::FromTM(expiry, absl::UTCTimeZone());
}

double CertificateWatch::DaysLeft() {
  if (file_.empty()) {
    return std::numeric_limits<double>::infinity();
  }
  const absl::StatusOr<absl::Time> expiry = CertificateExpiry(file_);
  if (!is_failing_.exchange(!expiry.ok()) && !expiry.ok()) {
    failures_.Add();
  }
  constexpr double kHoursOfDay = 24;
  return expiry.ok() ? absl::ToDoubleHours(*expiry - absl::Now()) / kHoursOfDay : 0;
}

}  // namespace isoscope::rpc
