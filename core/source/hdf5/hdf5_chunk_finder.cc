// The library looks up a chunk by its index of chunks, and then reads its bytes by the file's driver.
// So our driver (hdf5_driver.h) learns where the chunk lies, and reads nothing of it:
//
//   H5Dread_chunk(first)  ->  look-up in the index  ->  Read(raw data, offset, size)
//
// H5Dget_chunk_info and H5Dget_chunk_info_by_coord would walk over all chunks for each chunk
// (H5D__get_chunk_info_by_coord of version 1.10).

#include "core/source/hdf5/hdf5_chunk_finder.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/hdf5/hdf5_driver.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_file_lookup.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

// Readers take no larger chunks (hdf5_source.cc); a filter may add some bytes.
constexpr hsize_t kMaxStoredBytes = 512 * base::kMiB;
// What the library says of a chunk that was never written, unless no chunk was.
constexpr char kNotWritten[] = "chunk storage is not allocated";

}  // namespace

absl::StatusOr<Hdf5ChunkFinder> Hdf5ChunkFinder::Open(hid_t dataset, const std::string& name) {
  PrepareHdf5();
  const std::string path = Hdf5FileOf(dataset);
  H5O_info_t info{};
  if (H5Oget_info2(dataset, &info, H5O_INFO_BASIC) < 0) {
    return absl::DataLossError(
        absl::StrCat(name, ": how it is stored can't be read: ", LastHdf5Error()));
  }
  Hdf5Handle file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, Hdf5DriverAccess(Hdf5DriverFiles::kAll)),
                  H5Fclose);
  if (!file.is_valid()) {
    return Hdf5OpenError(path, LastHdf5Error());
  }
  Hdf5Handle again(H5Oopen_by_addr(file.get(), info.addr), H5Oclose);
  if (!again.is_valid() || H5Iget_type(again.get()) != H5I_DATASET) {
    return absl::DataLossError(absl::StrCat(name, ": can't be opened again: ", LastHdf5Error()));
  }
  return Hdf5ChunkFinder(name, std::move(file), std::move(again));
}

absl::StatusOr<std::optional<Hdf5Chunk>> Hdf5ChunkFinder::Find(const std::vector<hsize_t>& first) {
  hsize_t stored = 0;
  if (H5Dget_chunk_storage_size(dataset_.get(), first.data(), &stored) < 0) {
    const std::string said = LastHdf5Error();
    if (said == kNotWritten) {
      return std::nullopt;
    }
    return absl::DataLossError(absl::StrCat(name_, ": chunk at (", absl::StrJoin(first, ", "),
                                            ") can't be found: ", said, ": the file is damaged"));
  }
  if (stored == 0) {
    return std::nullopt;
  }
  if (stored > kMaxStoredBytes) {
    return absl::DataLossError(absl::StrCat(name_, ": chunk at (", absl::StrJoin(first, ", "),
                                            ") has ", stored, " bytes; expected at most ",
                                            kMaxStoredBytes, ": the file is damaged"));
  }
  if (stored > room_bytes_) {
    room_ = nullptr;
    room_bytes_ = static_cast<std::size_t>(stored);
    room_.reset(new char[room_bytes_]);  // no page of it is touched
  }
  Hdf5Chunk chunk;
  herr_t read = -1;
  const std::vector<io::FileRange> reads = NoteRawReads([&] {
    read = H5Dread_chunk(dataset_.get(), H5P_DEFAULT, first.data(), &chunk.skipped_filters,
                         room_.get());
  });
  if (read < 0 || reads.size() != 1 || reads.front().size != stored) {
    return absl::DataLossError(absl::StrCat(
        name_, ": chunk at (", absl::StrJoin(first, ", "), ") can't be found: ",
        read < 0 ? LastHdf5Error() : absl::StrCat("it is read in ", reads.size(), " parts"),
        ": the file is damaged or cut"));
  }
  chunk.offset = reads.front().offset;
  chunk.size = static_cast<std::int64_t>(stored);
  return chunk;
}

}  // namespace isoscope::source
