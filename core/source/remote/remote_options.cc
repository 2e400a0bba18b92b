#include "core/source/remote/remote_options.h"

#include <algorithm>
#include <cstdlib>
#include <initializer_list>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/remote/address.h"
#include "core/source/remote/aws_profile.h"
#include "core/source/remote/core_files.h"

namespace isoscope::source {
namespace {

// Variables that are empty count as not set.
class Variables {
 public:
  explicit Variables(const EnvironmentFunction& get) : get_(get) {}

  // The first of them that is set.
  [[nodiscard]] std::string First(std::initializer_list<const char*> names) const {
    for (const char* const name : names) {
      const char* const value = get_(name);
      if (value != nullptr && *value != '\0') {
        return value;
      }
    }
    return "";
  }
  [[nodiscard]] std::string operator[](const char* name) const { return First({name}); }
  // `name` below the home folder; empty if there is none.
  [[nodiscard]] std::string HomePath(absl::string_view name) const {
    const std::string home = First({"HOME"});
    return home.empty() ? "" : absl::StrCat(home, "/", name);
  }

 private:
  const EnvironmentFunction& get_;
};

// What goes into a header: bytes that end a line would begin another header.
bool IsHeaderText(absl::string_view text) {
  return std::all_of(text.begin(), text.end(),
                     [](char c) { return absl::ascii_isgraph(static_cast<unsigned char>(c)); });
}

absl::StatusOr<std::string> ParseOrigin(absl::string_view text, const char* variable) {
  const auto address = ParseAddress(text);
  if (!address.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(variable, ": ", address.status().message()));
  }
  if (address->is_s3 || address->path != "/" || !address->query.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        variable, ": is ", base::Quoted(RedactAddress(text)), "; expected https://HOST[:PORT]"));
  }
  return OriginOf(*address);
}

absl::StatusOr<BearerToken> BearerTokenFrom(const Variables& variables) {
  BearerToken bearer{.origin = "",
                     .token = Secret(variables["ISOSCOPE_BEARER_TOKEN"]),
                     .file = variables["ISOSCOPE_BEARER_TOKEN_FILE"]};
  if (bearer.token.empty() && bearer.file.empty()) {
    return bearer;
  }
  ForbidCores();  // before the file is read, too
  if (!bearer.token.empty() && !bearer.file.empty()) {
    return absl::InvalidArgumentError(
        "ISOSCOPE_BEARER_TOKEN and ISOSCOPE_BEARER_TOKEN_FILE are both set; expected one");
  }
  if (!IsHeaderText(bearer.token.Reveal())) {
    return absl::InvalidArgumentError(
        "ISOSCOPE_BEARER_TOKEN has a space, a line end or a letter beyond ASCII");
  }
  const std::string origin = variables["ISOSCOPE_BEARER_TOKEN_ORIGIN"];
  if (origin.empty()) {
    return absl::InvalidArgumentError(
        "ISOSCOPE_BEARER_TOKEN_ORIGIN is not set: the https://HOST[:PORT] that may see the token");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(bearer.origin, ParseOrigin(origin, "ISOSCOPE_BEARER_TOKEN_ORIGIN"));
  const Address address = *ParseAddress(bearer.origin);
  if (!address.is_https && !IsLoopback(address.host)) {
    return absl::InvalidArgumentError(
        "ISOSCOPE_BEARER_TOKEN_ORIGIN: begins with http://, which would show the token to others; "
        "expected https://HOST[:PORT]");
  }
  return bearer;
}

absl::StatusOr<S3Options::Addressing> ParseAddressing(absl::string_view text,
                                                      absl::string_view what) {
  if (text == "path") {
    return S3Options::Addressing::kPath;
  }
  if (text == "virtual") {
    return S3Options::Addressing::kVirtual;
  }
  if (text.empty() || text == "auto") {
    return S3Options::Addressing::kAutomatic;
  }
  return absl::InvalidArgumentError(
      absl::StrCat(what, ": is ", base::Quoted(text), "; expected path or virtual"));
}

// Credentials of variables, else of the profile; none if there are none.
absl::StatusOr<std::optional<AwsCredentials>> AwsCredentialsFrom(const Variables& variables,
                                                                 AwsSection* profile,
                                                                 const std::string& profile_name) {
  AwsCredentials credentials{.access_key_id = variables["AWS_ACCESS_KEY_ID"],
                             .secret_access_key = Secret(variables["AWS_SECRET_ACCESS_KEY"]),
                             .session_token = Secret(variables["AWS_SESSION_TOKEN"])};
  std::string where = "AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY";
  if (credentials.access_key_id.empty() && credentials.secret_access_key.empty()) {
    where = absl::StrCat("the AWS profile ", base::Quoted(profile_name));
    credentials = {.access_key_id = (*profile)["aws_access_key_id"],
                   .secret_access_key = Secret((*profile)["aws_secret_access_key"]),
                   .session_token = Secret((*profile)["aws_session_token"])};
    if (credentials.access_key_id.empty() && credentials.secret_access_key.empty()) {
      for (const char* const name : {"role_arn", "credential_process", "sso_session",
                                     "sso_start_url", "web_identity_token_file"}) {
        if (profile->contains(name)) {
          return absl::FailedPreconditionError(absl::StrCat(
              where, " has ", name, ", which Isoscope does not follow; set the variables that ",
              "`aws configure export-credentials --format env` prints"));
        }
      }
      return std::nullopt;
    }
  }
  ForbidCores();  // of variables
  if (credentials.access_key_id.empty() || credentials.secret_access_key.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": one of key id and secret key is missing; expected both or none"));
  }
  if (!IsHeaderText(credentials.access_key_id) ||
      !IsHeaderText(credentials.session_token.Reveal()) ||
      absl::StrContains(credentials.access_key_id, '/')) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": the key id or the session token has a letter that none has"));
  }
  return credentials;
}

absl::StatusOr<S3Options> S3OptionsFrom(const Variables& variables) {
  const std::string named = variables.First({"AWS_PROFILE", "AWS_DEFAULT_PROFILE"});
  const std::string profile_name = named.empty() ? "default" : named;
  const std::string config = variables["AWS_CONFIG_FILE"];
  const std::string shared = variables["AWS_SHARED_CREDENTIALS_FILE"];
  ISOSCOPE_ASSIGN_OR_RETURN(
      AwsProfile profile,
      ReadAwsProfile(config.empty() ? variables.HomePath(".aws/config") : config,
                     shared.empty() ? variables.HomePath(".aws/credentials") : shared,
                     profile_name));
  if (!named.empty() && !profile.is_found) {
    return absl::NotFoundError(absl::StrCat("AWS_PROFILE: there is no profile ",
                                            base::Quoted(named),
                                            " in ~/.aws/config or ~/.aws/credentials"));
  }
  S3Options s3;
  const std::string anonymous = variables["ISOSCOPE_S3_ANONYMOUS"];
  if (anonymous.empty() || anonymous == "0") {
    ISOSCOPE_ASSIGN_OR_RETURN(s3.credentials,
                              AwsCredentialsFrom(variables, &profile.values, profile_name));
  } else if (anonymous != "1") {
    return absl::InvalidArgumentError(
        absl::StrCat("ISOSCOPE_S3_ANONYMOUS: is ", base::Quoted(anonymous), "; expected 0 or 1"));
  }
  s3.region = variables.First({"AWS_REGION", "AWS_DEFAULT_REGION"});
  s3.region = s3.region.empty() ? profile.values["region"] : s3.region;
  if (!std::all_of(s3.region.begin(), s3.region.end(), [](char c) {
        return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_';
      })) {
    return absl::InvalidArgumentError(
        absl::StrCat("AWS_REGION: is ", base::Quoted(s3.region), "; expected one as us-east-1"));
  }
  std::string endpoint = variables.First({"AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"});
  endpoint = endpoint.empty() ? profile.values["endpoint_url"] : endpoint;
  if (!endpoint.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(s3.endpoint, ParseOrigin(endpoint, "AWS_ENDPOINT_URL"));
  }
  const std::string addressing = variables["ISOSCOPE_S3_ADDRESSING"];
  ISOSCOPE_ASSIGN_OR_RETURN(
      s3.addressing, addressing.empty() ? ParseAddressing(profile.values["s3.addressing_style"],
                                                          "s3.addressing_style")
                                        : ParseAddressing(addressing, "ISOSCOPE_S3_ADDRESSING"));
  return s3;
}

}  // namespace

absl::StatusOr<RemoteOptions> RemoteOptionsFrom(const EnvironmentFunction& get) {
  const Variables variables(get);
  RemoteOptions options;
  ISOSCOPE_ASSIGN_OR_RETURN(options.bearer, BearerTokenFrom(variables));
  const std::string netrc = variables["NETRC"];
  options.netrc_file = netrc.empty() ? variables.HomePath(".netrc") : netrc;
  if (netrc.empty() && !options.netrc_file.empty() && !io::PathExists(options.netrc_file)) {
    options.netrc_file.clear();
  }
  options.ca_file =
      variables.First({"ISOSCOPE_CA_FILE", "AWS_CA_BUNDLE", "CURL_CA_BUNDLE", "SSL_CERT_FILE"});
  absl::StatusOr<S3Options> s3 = S3OptionsFrom(variables);
  if (s3.ok()) {
    options.s3 = *std::move(s3);
  } else {
    options.s3.problem = s3.status();
  }
  return options;
}

absl::StatusOr<RemoteOptions> RemoteOptionsFromEnvironment() {
  return RemoteOptionsFrom([](const char* name) -> const char* {
    return std::getenv(name);  // NOLINT(concurrency-mt-unsafe): no thread sets variables
  });
}

}  // namespace isoscope::source
