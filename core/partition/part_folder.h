// The folder in which several processes cut one dataset, each its part (store/part_file.h has the
// layout). Parts know nothing of each other: none waits, locks or moves anything out of its folder.

#ifndef ISOSCOPE_CORE_PARTITION_PART_FOLDER_H_
#define ISOSCOPE_CORE_PARTITION_PART_FOLDER_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/partition/partition_plan.h"
#include "core/store/part_file.h"
#include "core/volume/block_layout.h"

namespace isoscope::partition {

// Returns the layers of blocks of a part: whole cubes of the order of blocks (store/block_order.h),
// as equal as they can be. Together the parts have each layer once. Some are empty if there are
// more parts than cubes.
LayerRange LayersOfPart(const volume::BlockLayout& layout, const store::PartNumber& part);

// The folder of the only volume of a dataset without fields and steps.
inline constexpr char kOnlyVolumeFolder[] = "volume";
// Behind the name of a part whose folder is under way.
inline constexpr char kTryInfix[] = ".try-";

// Paths for one output.
class PartFolder {
 public:
  // output: the dataset's folder to be; also with ".partial" behind it
  explicit PartFolder(std::string output);

  // True if parts of this dataset lie there.
  [[nodiscard]] bool Exists() const;
  // Makes the folders, unless another part has. FAILED_PRECONDITION: a run without parts works in
  // "<output>.partial", or was interrupted there.
  [[nodiscard]] absl::Status Make(const std::vector<std::string>& volumes) const;
  // Removes all parts. Nothing else is removed.
  [[nodiscard]] absl::Status Remove() const;

  [[nodiscard]] const std::string& output() const { return output_; }
  [[nodiscard]] std::string path() const { return output_ + ".partial"; }
  [[nodiscard]] std::string parts_path() const { return path() + "/parts"; }
  [[nodiscard]] std::string CutPath(const store::PartNumber& part) const;
  [[nodiscard]] std::string VolumePath(const std::string& volume) const;
  [[nodiscard]] std::string PiecePath(const std::string& volume,
                                      const store::PartNumber& part) const;

  // Writes what a part cuts, unless that is written.
  [[nodiscard]] absl::Status WriteCut(const store::PartCut& cut) const;
  // Returns what the parts that have begun cut, by index; some may have other counts. DATA_LOSS.
  [[nodiscard]] absl::StatusOr<std::vector<store::PartCut>> ReadCuts() const;
  // Returns what a part has finished of a volume; not set: nothing. DATA_LOSS.
  [[nodiscard]] absl::StatusOr<std::optional<store::PieceRecord>> ReadPiece(
      const std::string& volume, const store::PartNumber& part) const;

 private:
  std::string output_;
};

// The folders of the volumes of a cut: kOnlyVolumeFolder, or the names of those of a series.
std::vector<std::string> VolumesOf(const store::PartCut& cut);

// FAILED_PRECONDITION, with what differs and both values, if two parts are not of one dataset.
// folder: for the message
absl::Status CheckSameCut(const store::PartCut& a, const store::PartCut& b,
                          const PartFolder& folder);

// How far the parts of a dataset are.
struct PartState {
  store::PartNumber part;
  bool has_begun = false;
  int finished_volumes = 0;
  // Of the processes that are at work, or were until they died; the last news first.
  std::vector<store::PartProgress> tries;
};
struct PartsState {
  store::PartCut cut;
  int volume_count = 0;          // of each part
  std::vector<PartState> parts;  // by index
};
// NOT_FOUND: no part has begun. FAILED_PRECONDITION as CheckSameCut. DATA_LOSS.
absl::StatusOr<PartsState> ReadPartsState(const PartFolder& folder);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_PART_FOLDER_H_
