// Certificates of tests, made by the program openssl: an authority, and what it signs.

#ifndef ISOSCOPE_TESTS_SUPPORT_CERTIFICATES_H_
#define ISOSCOPE_TESTS_SUPPORT_CERTIFICATES_H_

#include <string>
#include <vector>

#include "rpc/transport.h"
#include "tests/support/temp_dir.h"

namespace isoscope::testing {

struct CertificateSpec {
  std::string name;  // of its files; also the CN
  // The alternative names, as openssl takes them: "DNS:agents,IP:127.0.0.1".
  std::string alternative_names = "DNS:localhost,IP:127.0.0.1";
  std::string role = {};  // empty: none
  int days = 2;           // of validity; negative: it has expired
};

// Thread-compatible. All functions fail the test if openssl does.
class TestAuthority {
 public:
  TestAuthority();

  // Writes NAME.pem and NAME.key, in place of those that are there, and returns their paths with
  // the authority's.
  rpc::TransportFlags Issue(const CertificateSpec& spec) const;
  // The same for a role, named after it, at every address of this machine.
  rpc::TransportFlags IssueRole(const std::string& role) const {
    return Issue({.name = role, .role = role});
  }
  [[nodiscard]] std::string ca_file() const { return folder_.Sub("ca.pem"); }
  [[nodiscard]] std::string Path(const std::string& name) const { return folder_.Sub(name); }

 private:
  TempDir folder_;
};

// Writes a file in place of the one that is there, at once.
void ReplaceFile(const std::string& path, const std::string& text);

// The flags of a command line: "--tls-cert", FILE, ...
std::vector<std::string> FlagsOf(const rpc::TransportFlags& transport);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_CERTIFICATES_H_
