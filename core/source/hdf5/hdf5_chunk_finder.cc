// The library looks up a chunk by its index of chunks, and then reads its bytes by the file's driver
// (H5FD). So a driver of ours learns where the chunk lies:
//
//   H5Dread_chunk(first)  ->  look-up in the index  ->  NoteRead(raw data, offset, size)
//
// While a chunk is looked for, the driver notes raw data, and does not read them. It reads all else.
// H5Dget_chunk_info and H5Dget_chunk_info_by_coord would walk over all chunks for each chunk
// (H5D__get_chunk_info_by_coord of version 1.10).

#include "core/source/hdf5/hdf5_chunk_finder.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_file_lookup.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

// Readers take no larger chunks (hdf5_source.cc); a filter may add some bytes.
constexpr hsize_t kMaxStoredBytes = 512 * base::kMiB;
// What the library says of a chunk that was never written, unless no chunk was.
constexpr char kNotWritten[] = "chunk storage is not allocated";

// What the driver was asked for while a chunk was looked for. The library has one thread.
struct Notes {
  bool are_taken = false;
  std::vector<Hdf5Chunk> reads{};
};
Notes& NotesOfProcess() {
  static Notes notes;
  return notes;
}

// The library knows the base.
struct NotingFile : H5FD_t {
  NotingFile() : H5FD_t{} {}

  std::unique_ptr<io::RandomAccessFile> file;
  haddr_t end = 0;  // of the addresses in use, as the library sets it
};

NotingFile* NotingOf(H5FD_t* file) { return static_cast<NotingFile*>(file); }
const NotingFile* NotingOf(const H5FD_t* file) { return static_cast<const NotingFile*>(file); }

H5FD_t* OpenNoting(const char* name, unsigned flags, hid_t /*access*/, haddr_t /*max_address*/) {
  if ((flags & (H5F_ACC_RDWR | H5F_ACC_CREAT | H5F_ACC_TRUNC)) != 0) {
    return nullptr;
  }
  auto opened = io::OpenRandomAccessFile(name);
  if (!opened.ok()) {
    return nullptr;
  }
  auto file = std::make_unique<NotingFile>();
  file->file = *std::move(opened);
  return file.release();  // CloseNoting has it
}

herr_t CloseNoting(H5FD_t* file) {
  delete NotingOf(file);
  return 0;
}

int CompareNoting(const H5FD_t* a, const H5FD_t* b) {
  return std::clamp(NotingOf(a)->file->path().compare(NotingOf(b)->file->path()), -1, 1);
}

haddr_t EndOfNotingAddresses(const H5FD_t* file, H5FD_mem_t /*type*/) {
  return NotingOf(file)->end;
}

herr_t SetEndOfNotingAddresses(H5FD_t* file, H5FD_mem_t /*type*/, haddr_t end) {
  NotingOf(file)->end = end;
  return 0;
}

haddr_t EndOfNotingFile(const H5FD_t* file, H5FD_mem_t /*type*/) {
  return static_cast<haddr_t>(NotingOf(file)->file->size_bytes());
}

herr_t NoteRead(H5FD_t* file, H5FD_mem_t type, hid_t /*transfer*/, haddr_t address,
                std::size_t size, void* out) {
  Notes& notes = NotesOfProcess();
  if (notes.are_taken && type == H5FD_MEM_DRAW) {
    notes.reads.push_back(
        {.offset = static_cast<std::int64_t>(address), .size = static_cast<std::int64_t>(size)});
    return 0;
  }
  const io::RandomAccessFile& from = *NotingOf(file)->file;
  const auto end = static_cast<haddr_t>(from.size_bytes());
  // Behind the end of a file are zeros, as for the library's own drivers.
  const std::size_t take =
      address >= end ? 0 : static_cast<std::size_t>(std::min<haddr_t>(size, end - address));
  std::memset(static_cast<char*>(out) + take, 0, size - take);
  const bool is_read =
      take == 0 ||
      from.ReadAt(static_cast<std::int64_t>(address), take, static_cast<char*>(out)).ok();
  return is_read ? 0 : -1;
}

herr_t RefuseWrite(H5FD_t* /*file*/, H5FD_mem_t /*type*/, hid_t /*transfer*/, haddr_t /*address*/,
                   std::size_t /*size*/, const void* /*bytes*/) {
  return -1;
}

hid_t NotingDriver() {
  static const hid_t driver = [] {
    H5FD_class_t functions{};
    functions.name = "isoscope_noting";
    functions.maxaddr = static_cast<haddr_t>(std::numeric_limits<std::int64_t>::max());
    functions.fc_degree = H5F_CLOSE_WEAK;
    functions.open = OpenNoting;
    functions.close = CloseNoting;
    functions.cmp = CompareNoting;
    functions.get_eoa = EndOfNotingAddresses;
    functions.set_eoa = SetEndOfNotingAddresses;
    functions.get_eof = EndOfNotingFile;
    functions.read = NoteRead;
    functions.write = RefuseWrite;
    // All kinds of bytes lie in one range of addresses.
    std::fill(std::begin(functions.fl_map), std::end(functions.fl_map), H5FD_MEM_SUPER);
    return H5FDregister(&functions);
  }();
  return driver;
}

}  // namespace

absl::StatusOr<Hdf5ChunkFinder> Hdf5ChunkFinder::Open(hid_t dataset, const std::string& name) {
  PrepareHdf5();
  const std::string path = Hdf5FileOf(dataset);
  H5O_info_t info{};
  const Hdf5Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  if (H5Oget_info2(dataset, &info, H5O_INFO_BASIC) < 0 ||
      H5Pset_driver(access.get(), NotingDriver(), nullptr) < 0) {
    return absl::DataLossError(
        absl::StrCat(name, ": how it is stored can't be read: ", LastHdf5Error()));
  }
  Hdf5Handle file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access.get()), H5Fclose);
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
  Notes& notes = NotesOfProcess();
  notes = {.are_taken = true};
  Hdf5Chunk chunk;
  const herr_t read =
      H5Dread_chunk(dataset_.get(), H5P_DEFAULT, first.data(), &chunk.skipped_filters, room_.get());
  notes.are_taken = false;
  if (read < 0 || notes.reads.size() != 1 ||
      notes.reads.front().size != static_cast<std::int64_t>(stored)) {
    return absl::DataLossError(absl::StrCat(
        name_, ": chunk at (", absl::StrJoin(first, ", "), ") can't be found: ",
        read < 0 ? LastHdf5Error() : absl::StrCat("it is read in ", notes.reads.size(), " parts"),
        ": the file is damaged or cut"));
  }
  chunk.offset = notes.reads.front().offset;
  chunk.size = notes.reads.front().size;
  return chunk;
}

}  // namespace isoscope::source
