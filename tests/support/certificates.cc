#include "tests/support/certificates.h"

#include <cstdio>
#include <utility>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/process.h"
#include "tests/support/status_matchers.h"

namespace isoscope::testing {
namespace {

void OpenSsl(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "/usr/bin/openssl");
  const CommandResult result = RunCommand(arguments, {});
  ASSERT_EQ(result.exit_code, 0) << arguments[1] << ": " << result.err;
}

std::vector<std::string> Request(const std::string& name, const std::string& key,
                                 const std::string& out) {
  return {"req",
          "-newkey",
          "ec",
          "-pkeyopt",
          "ec_paramgen_curve:P-256",
          "-nodes",
          "-subj",
          absl::StrCat("/CN=", name),
          "-keyout",
          key,
          "-out",
          out};
}

}  // namespace

TestAuthority::TestAuthority() {
  std::vector<std::string> arguments =
      Request("test authority", folder_.Sub("ca.key"), folder_.Sub("ca.pem"));
  arguments.insert(arguments.begin() + 1, {"-x509", "-days", "2"});
  OpenSsl(std::move(arguments));
}

rpc::TransportFlags TestAuthority::Issue(const CertificateSpec& spec) const {
  const rpc::TransportFlags files{.certificate_file = folder_.Sub(spec.name + ".pem"),
                                  .key_file = folder_.Sub(spec.name + ".key"),
                                  .ca_file = ca_file()};
  OpenSsl(Request(spec.name, folder_.Sub("new.key"), folder_.Sub("request")));
  const std::string role = spec.role.empty() ? "" : absl::StrCat(",URI:isoscope:role:", spec.role);
  ReplaceFile(folder_.Sub("extensions"),
              absl::StrCat("subjectAltName=", spec.alternative_names, role, "\n"));
  OpenSsl({"x509", "-req", "-in", folder_.Sub("request"), "-CA", ca_file(), "-CAkey",
           folder_.Sub("ca.key"), "-CAcreateserial", "-days", absl::StrCat(spec.days), "-extfile",
           folder_.Sub("extensions"), "-out", folder_.Sub("new.pem")});
  // As an operator does it: each file is replaced at once.
  EXPECT_EQ(rename(folder_.Sub("new.key").c_str(), files.key_file.c_str()), 0);
  EXPECT_EQ(rename(folder_.Sub("new.pem").c_str(), files.certificate_file.c_str()), 0);
  return files;
}

void ReplaceFile(const std::string& path, const std::string& text) {
  const std::string made = path + ".new";
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(made, text));
  ASSERT_EQ(rename(made.c_str(), path.c_str()), 0);
}

std::vector<std::string> FlagsOf(const rpc::TransportFlags& transport) {
  std::vector<std::string> flags;
  for (const auto& [flag, value] :
       {std::pair("--tls-cert", transport.certificate_file),
        std::pair("--tls-key", transport.key_file), std::pair("--tls-ca", transport.ca_file),
        std::pair("--tls-server-name", transport.server_name)}) {
    if (!value.empty()) {
      flags.emplace_back(flag);
      flags.push_back(value);
    }
  }
  return flags;
}

}  // namespace isoscope::testing
