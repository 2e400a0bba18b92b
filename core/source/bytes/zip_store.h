// The members of a ZIP archive as objects, read by ranges: nothing but the central directory is
// read before a member is asked for.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_ZIP_STORE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_ZIP_STORE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/bytes/byte_source.h"
#include "core/source/bytes/object_store.h"

namespace isoscope::source {

// Thread-safe.
class ZipStore : public ObjectStore {
 public:
  // The names of members, in order, folders left out.
  [[nodiscard]] virtual std::vector<std::string> Names() const = 0;
  // The names one level below a folder of members ("" for the top).
  [[nodiscard]] virtual std::vector<std::string> NamesBelow(const std::string& folder) const = 0;
};

// Reads the central directory, Zip64 too. Members are stored, whose ranges are read alone, or
// deflated: these are inflated as a whole, and must fit max_size of a read, or 256 MiB if a part of
// them is read. `folder`: keys are names
// below it; "" for all.
//
// Of two members of one name, as zarr-python writes them, the last one counts. INVALID_ARGUMENT: as
// ReadZipDirectory, of at most 1 GiB and 20 000 000 members. Errors of a read also: INVALID_ARGUMENT for a member that is encrypted or
// compressed by another method, with its name; DATA_LOSS: damaged, or another checksum.
absl::StatusOr<std::unique_ptr<ZipStore>> OpenZipStore(std::shared_ptr<const ByteSource> bytes,
                                                       const std::string& folder = "");

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_ZIP_STORE_H_
