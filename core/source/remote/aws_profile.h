// The files of AWS's own tools, ~/.aws/config and ~/.aws/credentials: sections of `name = value`.
//
//   [default]                        [profile lab]          of credentials: [lab]
//   region = eu-central-1            endpoint_url = https://s3.lab.example:9000
//                                    s3 =
//                                      addressing_style = path
//
// Source: AWS, "Configuration and credential file settings",
// https://docs.aws.amazon.com/cli/latest/userguide/cli-configure-files.html.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_AWS_PROFILE_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_AWS_PROFILE_H_

#include <map>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::source {

// Name: value. Nested values have both names: "s3.addressing_style". Names are in lower case.
using AwsSection = std::map<std::string, std::string>;

// Returns the sections by name; "[profile lab]" is "lab". `path` is for errors: INVALID_ARGUMENT
// names the line, and none of its text, which may be a secret.
absl::StatusOr<std::map<std::string, AwsSection>> ParseAwsFile(absl::string_view text,
                                                               const std::string& path);

// The values of a profile in both files; those of the credentials file win.
struct AwsProfile {
  bool is_found = false;
  AwsSection values;
};
// A file that is not there has no profiles. Others: INVALID_ARGUMENT if it is larger than 1 MiB, and
// as ParseAwsFile; PERMISSION_DENIED.
absl::StatusOr<AwsProfile> ReadAwsProfile(const std::string& config_path,
                                          const std::string& credentials_path,
                                          const std::string& profile);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_AWS_PROFILE_H_
