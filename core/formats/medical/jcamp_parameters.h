// Files of parameters in JCAMP-DX, as Bruker's ParaVision writes them:
//
//   ##TITLE=Parameter List
//   $$ a comment, which may be anywhere
//   ##$VisuCoreDim=2
//   ##$VisuCorePosition=( 5, 3 )        an array, by its sizes; then its elements, in any lines
//   -22 -21.2 @3*(0) 1                  @3*(0) repeats three times
//   ##END=

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_JCAMP_PARAMETERS_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_JCAMP_PARAMETERS_H_

#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::source {

// All errors are INVALID_ARGUMENT and name the file.
class JcampParameters {
 public:
  // `path` is for messages.
  explicit JcampParameters(std::string path) : path_(std::move(path)) {}

  // `name` is without "##$".
  void Set(absl::string_view name, absl::string_view text);

  // Returns the text without the sizes of an array in front; "" if it is absent.
  [[nodiscard]] absl::string_view Text(const std::string& name) const;
  // An integer from 1 to `most`.
  [[nodiscard]] absl::StatusOr<std::int64_t> Count(const std::string& name,
                                                   std::int64_t most) const;
  // None if it is absent; all finite, and 9 million at most.
  [[nodiscard]] absl::StatusOr<std::vector<double>> Numbers(const std::string& name) const;
  // The same; an error unless they are as many as one of `counts`.
  [[nodiscard]] absl::StatusOr<std::vector<double>> Numbers(
      const std::string& name, const std::set<std::size_t>& counts) const;

  [[nodiscard]] absl::Status Error(absl::string_view text) const;

 private:
  const std::string path_;
  std::map<std::string, std::string> parameters_;
};

// Reads the file, 4 MiB at most. NOT_FOUND. INVALID_ARGUMENT: it has no ##END.
absl::StatusOr<JcampParameters> ReadJcampParameters(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_JCAMP_PARAMETERS_H_
