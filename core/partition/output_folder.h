// The folder that a dataset is written to: it appears whole, or not at all.

#ifndef ISOSCOPE_CORE_PARTITION_OUTPUT_FOLDER_H_
#define ISOSCOPE_CORE_PARTITION_OUTPUT_FOLDER_H_

#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/process_interrupt.h"
#include "core/io/work_folder.h"

namespace isoscope::partition {

// Returns the last part of a path.
std::string BaseName(const std::string& path);

// Removed with everything in it unless Commit was called. Thread-compatible.
class OutputFolder {
 public:
  // Checks the name of the folder and of the dataset, which is that of the folder if `name` is
  // empty, and that the folder can be made. Writes nothing. INVALID_ARGUMENT: a name.
  // ALREADY_EXISTS: the folder. NOT_FOUND: its parent.
  static absl::StatusOr<std::unique_ptr<OutputFolder>> Make(const std::string& path,
                                                            const std::string& name);
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

  // Creates "<path>.partial-XXXXXX" (io::WorkFolder), where files are written until Commit renames
  // it. Removes those of this output whose processes have ended.
  absl::Status Create();
  absl::Status Commit();

  // REQUIRES: Create was called.
  [[nodiscard]] const std::string& partial_path() const { return partial_->path(); }
  [[nodiscard]] const std::string& name() const { return name_; }  // of the dataset

 private:
  OutputFolder(std::string path, std::string name);

  const std::string path_;
  const std::string name_;
  std::optional<base::UnfinishedPath> unfinished_;  // ends after the folder
  std::optional<io::WorkFolder> partial_;
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_OUTPUT_FOLDER_H_
