// Who reads a box:
//
//   dataset                                   reader
//   chunks, of filters that we know           StoredArray, over ranges of the file
//   no chunks                                 FileSource, as a raw file
//   else                                      the library, in a child of its own (RowBoxes)
//   one of the first two says DATA_LOSS       the library; ours is the error if it fails, too
//
// Filters are codecs of Zarr in the order of writing, behind one that makes bytes of numbers. A
// filter that makes a chunk no smaller may be left out of it, so chunks differ. There is an array for
// each set of filters that were left out, and each chunk is read by its own.
//
//   run.h5:/v   chunk 0: gzip       array {gzip}
//               chunk 1: plain      array {}
//               chunk 2: missing    array {gzip}, which fills it
//
// The fill value is what the library read from a missing chunk.

#include "core/formats/hdf5/hdf5_boxes.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"

#include "core/base/cancellation.h"
#include "core/base/check.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_chunk_table.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/bytes/file_source.h"
#include "core/source/bytes/object_store.h"
#include "core/source/bytes/sample_location.h"
#include "core/source/chunks/chunk_box.h"
#include "core/source/chunks/chunk_codec.h"
#include "core/source/chunks/stored_array.h"

namespace isoscope::source {
namespace {

// Rows and planes of a box that the library reads, of a dataset without chunks.
constexpr std::int64_t kRowBoxEdge = 32;
constexpr absl::string_view kChunkKey = "chunk ";

// ---- By the library. ----------------------------------------------------------------------------

// How a child is asked.
struct WalledDataset {
  WalledLibrary library;
  std::string path;
  std::string part;
};

// Opens the rows once more. DATA_LOSS also: the dataset is another one.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenRows(const SourceInfo& info,
                                                       const WalledDataset& dataset) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> rows,
                            OpenWalled(dataset.library, dataset.path, dataset.part));
  if (!(rows->info().geometry.sample_dims == info.geometry.sample_dims) ||
      rows->info().type != info.type) {
    return absl::DataLossError(absl::StrCat(info.name, ": has changed since it was opened"));
  }
  return rows;
}

class RowBoxes final : public VolumeSource {
 public:
  // `box_dims`: of the grid, but for x.
  RowBoxes(const SourceInfo& info, WalledDataset dataset, math::Index3 box_dims)
      : VolumeSource(info), dataset_(std::move(dataset)), box_dims_(box_dims) {
    box_dims_.x = info.geometry.sample_dims.x;
  }

  absl::Status ReadRows(std::int64_t /*begin_row*/, std::int64_t /*end_row*/,
                        char* /*out*/) override {
    return absl::UnimplementedError("boxes alone");
  }
  [[nodiscard]] std::optional<BoxGrid> box_grid() const override {
    return BoxGrid{.box_dims = box_dims_};
  }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& cancellation) const override {
    const base::MutexLock lock(&mutex_);
    const absl::Status status = ReadLocked(box, out, cancellation);
    if (!status.ok()) {
      rows_ = nullptr;  // after an error a child reads no more
    }
    return status;
  }

 private:
  absl::Status ReadLocked(const math::IndexBox& box, char* out,
                          const base::Cancellation& cancellation) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (rows_ == nullptr) {
      ISOSCOPE_ASSIGN_OR_RETURN(rows_, OpenRows(info(), dataset_));
    }
    const auto sample_bytes = static_cast<std::int64_t>(volume::SizeOf(info().type));
    const math::Index3 dims = box.dims();
    std::string rows(static_cast<std::size_t>(dims.y * info().row_bytes()), '\0');
    for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
      const std::int64_t first = z * info().geometry.sample_dims.y;
      ISOSCOPE_RETURN_IF_ERROR(
          rows_->ReadRows(first + box.begin.y, first + box.end.y, rows.data()));
      for (std::int64_t y = 0; y < dims.y; ++y) {
        out = std::copy_n(rows.data() + y * info().row_bytes() + box.begin.x * sample_bytes,
                          dims.x * sample_bytes, out);
      }
    }
    return absl::OkStatus();
  }

  const WalledDataset dataset_;
  math::Index3 box_dims_;
  mutable base::Mutex mutex_;
  mutable std::unique_ptr<VolumeSource> rows_ ABSL_GUARDED_BY(mutex_);
};

// ---- In chunks. ---------------------------------------------------------------------------------

// The chunks of a table: "chunk 17" is an object.
class TableStore final : public ObjectStore {
 public:
  TableStore(std::unique_ptr<io::RandomAccessFile> file,
             std::shared_ptr<const Hdf5ChunkTable> table)
      : file_(std::move(file)), table_(std::move(table)) {
    const auto mounted = io::FindMounted(file_->path());
    read_pieces_ = mounted.has_value() ? mounted->read_pieces : nullptr;
  }

  [[nodiscard]] std::vector<absl::StatusOr<std::string>> Read(
      absl::Span<const ObjectRead> reads, const base::Cancellation& cancellation) const override {
    std::vector<absl::StatusOr<std::string>> answers;
    std::vector<io::FilePiece> pieces;
    for (const ObjectRead& read : reads) {
      const absl::StatusOr<Hdf5TableChunk> chunk = ChunkOf(read);
      answers.push_back(chunk.ok() ? absl::StatusOr<std::string>(std::string(chunk->size, '\0'))
                                   : chunk.status());
      if (chunk.ok()) {
        pieces.push_back({.range = {.offset = chunk->offset, .size = chunk->size}});
      }
    }
    auto piece = pieces.begin();
    for (absl::StatusOr<std::string>& answer : answers) {
      if (answer.ok()) {
        piece++->out = answer->data();
      }
    }
    const absl::Status status = ReadPieces(pieces, cancellation);
    for (absl::StatusOr<std::string>& answer : answers) {
      if (!status.ok() && answer.ok()) {
        answer = status;
      }
    }
    return answers;
  }
  [[nodiscard]] absl::StatusOr<std::unique_ptr<ByteSource>> Open(
      const std::string& key, const base::Cancellation& /*cancellation*/) const override {
    return absl::UnimplementedError(absl::StrCat(name(), ": ", key, ": is read as a whole"));
  }
  [[nodiscard]] const std::string& name() const override { return file_->path(); }

 private:
  [[nodiscard]] absl::StatusOr<Hdf5TableChunk> ChunkOf(const ObjectRead& read) const {
    absl::string_view number = read.key;
    std::size_t i = 0;
    ISOSCOPE_CHECK(absl::ConsumePrefix(&number, kChunkKey) && absl::SimpleAtoi(number, &i) &&
                   i < table_->chunks.size() && read.offset == 0 && read.size < 0);
    const Hdf5TableChunk& chunk = table_->chunks[i];
    if (chunk.size == 0) {
      return absl::NotFoundError("was never written");
    }
    if (static_cast<std::int64_t>(chunk.size) > read.max_size) {
      return absl::ResourceExhaustedError(absl::StrCat("has ", chunk.size, " bytes"));
    }
    return chunk;
  }

  // At an address all at once.
  [[nodiscard]] absl::Status ReadPieces(const std::vector<io::FilePiece>& pieces,
                                        const base::Cancellation& cancellation) const {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    if (read_pieces_ != nullptr && !pieces.empty()) {
      return read_pieces_(pieces, cancellation);
    }
    for (const io::FilePiece& piece : pieces) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
      ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(piece.range.offset, piece.range.size, piece.out));
    }
    return absl::OkStatus();
  }

  const std::unique_ptr<io::RandomAccessFile> file_;
  const std::shared_ptr<const Hdf5ChunkTable> table_;
  // Null: pieces are read one after the other.
  std::function<absl::Status(absl::Span<const io::FilePiece>, const base::Cancellation&)>
      read_pieces_;
};

std::uint32_t MaskOf(const Hdf5ChunkTable& table) {
  return table.filters.size() >= 32 ? ~std::uint32_t{0}
                                    : (std::uint32_t{1} << table.filters.size()) - 1;
}

// The codecs of chunks that leave out the filters of `skipped`. Not set: only the library has one of
// them, or knows what it does with so many bytes.
std::optional<std::vector<CodecSpec>> CodecsOf(const Hdf5ChunkTable& table, std::uint32_t skipped) {
  // Numbers of filters: hdf5_filters.cc.
  static const auto* const names = new std::map<std::int64_t, std::string>{
      {1, "zlib"}, {307, "bz2"}, {32001, "blosc"}, {32015, "zstd"}};
  std::vector<CodecSpec> codecs{
      {.name = "bytes",
       .configuration = {{"endian", table.type.is_big_endian ? "big" : "little"}}}};
  std::int64_t size = CheckedVolume(
      table.chunk_dims, static_cast<std::int64_t>(SizeOf(table.type.type)), kMaxChunkBytes);
  bool is_exact = size >= 0;
  for (std::size_t i = 0; i < table.filters.size(); ++i) {
    const Hdf5TableFilter& filter = table.filters[i];
    if (i < 32 && (skipped >> i & 1U) != 0) {
      continue;
    }
    if (const auto compressor = names->find(filter.id); compressor != names->end()) {
      codecs.push_back({.name = compressor->second});
      is_exact = false;
    } else if (filter.id == 2 && !filter.values.empty() && filter.values[0] >= 1 &&
               filter.values[0] <= 256 && is_exact && size % filter.values[0] == 0) {
      // Bytes that are left over are no elements: the library leaves them at the end.
      codecs.push_back({.name = "shuffle", .configuration = {{"elementsize", filter.values[0]}}});
    } else if (filter.id == 3) {
      codecs.push_back({.name = "fletcher32"});
      size += 4;
    } else {
      return std::nullopt;
    }
  }
  return codecs;
}

using Arrays = std::map<std::uint32_t, std::unique_ptr<ChunkedArray>>;  // by skipped filters

class ChunkBoxes final : public VolumeSource {
 public:
  ChunkBoxes(SourceInfo info, std::shared_ptr<const Hdf5ChunkTable> table, Arrays arrays)
      : VolumeSource(std::move(info)),
        table_(std::move(table)),
        counts_(table_->counts()),
        arrays_(std::move(arrays)) {}

  absl::Status ReadRows(std::int64_t /*begin_row*/, std::int64_t /*end_row*/,
                        char* /*out*/) override {
    return absl::UnimplementedError("boxes alone");
  }
  [[nodiscard]] std::optional<BoxGrid> box_grid() const override {
    const ChunkIndex& chunk = table_->chunk_dims;
    const auto& [z, y, x] = table_->space;
    return BoxGrid{.box_dims = {chunk[x], chunk[y], chunk[z]}};
  }
  // Chunks of several steps or components are decoded whole for each of them.
  [[nodiscard]] std::int64_t decoding_factor() const override {
    std::int64_t factor = 1;
    for (std::size_t axis = 0; axis < table_->dims.size(); ++axis) {
      const auto& space = table_->space;
      const bool is_space = std::find(space.begin(), space.end(), axis) != space.end();
      factor *= is_space ? 1 : table_->chunk_dims[axis];
    }
    return factor;
  }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& cancellation) const override {
    ChunkBox wanted{.begin = table_->start, .end = table_->start};
    for (std::int64_t& end : wanted.end) {
      ++end;
    }
    for (std::size_t i = 0; i < 3; ++i) {
      wanted.begin[table_->space[i]] = box.begin[2 - static_cast<int>(i)];
      wanted.end[table_->space[i]] = box.end[2 - static_cast<int>(i)];
    }
    const ChunkGrid grid(table_->dims, table_->chunk_dims);
    const ChunkBox chunks = grid.ChunksOf(wanted);
    if (const auto skipped = OnlySkippedOf(chunks); skipped.has_value()) {
      return arrays_.at(*skipped)->ReadBox(wanted, out, nullptr, cancellation);
    }
    const std::size_t size = volume::SizeOf(info().type);
    std::string samples;
    ChunkIndex index = chunks.begin;
    do {
      const ChunkBox part = IntersectionOf(grid.ElementsOf(index), wanted);
      const std::int64_t bytes = BytesOf(part, size);
      samples.resize(static_cast<std::size_t>(bytes));
      ISOSCOPE_RETURN_IF_ERROR(arrays_.at(ChunkAt(index).skipped_filters & MaskOf(*table_))
                                   ->ReadBox(part, samples.data(), nullptr, cancellation));
      CopyPart(part, size, part, samples.data(), wanted, out);
    } while (NextIndex(chunks, &index));
    return absl::OkStatus();
  }

 private:
  static std::int64_t BytesOf(const ChunkBox& box, std::size_t size) {
    auto bytes = static_cast<std::int64_t>(size);
    for (std::size_t axis = 0; axis < box.begin.size(); ++axis) {
      bytes *= box.end[axis] - box.begin[axis];
    }
    return bytes;
  }
  [[nodiscard]] const Hdf5TableChunk& ChunkAt(const ChunkIndex& index) const {
    const auto& [z, y, x] = table_->space;
    return table_->chunks[static_cast<std::size_t>((index[z] * counts_[1] + index[y]) * counts_[2] +
                                                   index[x])];
  }
  // The filters that all of those chunks leave out; not set if they differ.
  [[nodiscard]] std::optional<std::uint32_t> OnlySkippedOf(const ChunkBox& chunks) const {
    std::optional<std::uint32_t> only;
    ChunkIndex index = chunks.begin;
    do {
      const Hdf5TableChunk& chunk = ChunkAt(index);
      const std::uint32_t skipped = chunk.skipped_filters & MaskOf(*table_);
      if (chunk.size != 0 && only.value_or(skipped) != skipped) {
        return std::nullopt;
      }
      only = chunk.size != 0 ? skipped : only;
    } while (NextIndex(chunks, &index));
    return only.value_or(0);
  }

  const std::shared_ptr<const Hdf5ChunkTable> table_;
  const std::array<std::int64_t, 3> counts_;
  const Arrays arrays_;
};

// ---- Opening. -----------------------------------------------------------------------------------

absl::Status NoSense(const SourceInfo& info) {
  return absl::DataLossError(absl::StrCat(
      info.name, ": what HDF5 says of its chunks makes no sense: the file is damaged"));
}

// The type of the samples in a volume, and the volume of those.
absl::StatusOr<std::unique_ptr<VolumeSource>> AsVolume(const SourceInfo& info, NumberType type,
                                                       std::unique_ptr<VolumeSource> stored) {
  const std::optional<WideType> wide = SampleTypeOf(type).wide;
  std::unique_ptr<VolumeSource> volume =
      wide.has_value() ? MakeWideSource(std::move(stored), *wide) : std::move(stored);
  if (volume->info().type != info.type) {
    return NoSense(info);
  }
  return volume;
}

bool HasSizesOf(const SourceInfo& info, const Hdf5ChunkTable& table, bool are_equal) {
  bool fit = true;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::int64_t samples = info.geometry.sample_dims[2 - static_cast<int>(i)];
    const std::int64_t size = table.dims[table.space[i]];
    fit = fit && (are_equal ? samples == size : samples <= size);
  }
  return fit;
}

// Null: only the library can read it.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenPlain(const SourceInfo& info,
                                                        const Hdf5ChunkTable& table) {
  const SampleType type = SampleTypeOf(table.type.type);
  SampleLocation location{.files = {table.file},
                          .offset = table.plain_offset,
                          .has_more_behind = true,
                          .is_big_endian = table.type.is_big_endian,
                          .stored_type = type.stored};
  // Other axes count volumes in front of z, and components behind x.
  for (std::size_t axis = 0; axis < table.dims.size(); ++axis) {
    if (axis < table.space[0]) {
      location.volume_count *= table.dims[axis];
      location.volume = location.volume * table.dims[axis] + table.start[axis];
    } else if (axis > table.space[2]) {
      location.components *= table.dims[axis];
      location.component = location.component * table.dims[axis] + table.start[axis];
    } else if (table.dims[axis] > 1 &&
               std::find(table.space.begin(), table.space.end(), axis) == table.space.end()) {
      return nullptr;
    }
  }
  if (!HasSizesOf(info, table, true)) {
    return nullptr;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> stored,
                            MakeFileSource(info.geometry, location, info.name, info.patient_frame));
  return AsVolume(info, table.type.type, std::move(stored));
}

absl::Status CheckInFile(const SourceInfo& info, const Hdf5ChunkTable& table,
                         std::int64_t file_bytes) {
  for (std::size_t i = 0; i < table.chunks.size(); ++i) {
    const Hdf5TableChunk& chunk = table.chunks[i];
    if (chunk.offset > file_bytes || chunk.size > file_bytes - chunk.offset) {
      return absl::DataLossError(absl::StrFormat(
          "%s: chunk %d has %d bytes from byte %d on of '%s', which has %d: it is damaged or cut",
          info.name, i, chunk.size, chunk.offset, table.file, file_bytes));
    }
  }
  return absl::OkStatus();
}

// Null: only the library can read it.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenChunks(const SourceInfo& info,
                                                         Hdf5ChunkTable read) {
  if (!HasSizesOf(info, read, false)) {
    return NoSense(info);
  }
  const auto table = std::make_shared<const Hdf5ChunkTable>(std::move(read));
  std::map<std::uint32_t, std::vector<CodecSpec>> codecs;
  constexpr std::size_t kMaxSets = 64;
  const auto add = [&](std::uint32_t skipped) {
    if (codecs.contains(skipped)) {
      return true;
    }
    auto known = CodecsOf(*table, skipped);
    if (!known.has_value() || codecs.size() == kMaxSets) {
      return false;
    }
    codecs[skipped] = *std::move(known);
    return true;
  };
  bool are_known = add(0);
  for (const Hdf5TableChunk& chunk : table->chunks) {
    are_known = are_known && add(chunk.skipped_filters & MaskOf(*table));
  }
  if (!are_known) {
    return nullptr;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(table->file));
  ISOSCOPE_RETURN_IF_ERROR(CheckInFile(info, *table, file->size_bytes()));
  const auto store = std::make_shared<const TableStore>(std::move(file), table);
  Arrays arrays;
  for (const auto& [skipped, specs] : codecs) {
    StoredArraySpec spec{
        .name = info.name,
        .dims = table->dims,
        .chunk_dims = table->chunk_dims,
        .type = table->type.type,
        .fill = table->fill.empty() ? std::string(SizeOf(table->type.type), '\0') : table->fill,
        .codecs = specs,
        .key_of = [table, counts = table->counts()](const ChunkIndex& index) {
          const auto& [z, y, x] = table->space;
          return absl::StrCat(kChunkKey, (index[z] * counts[1] + index[y]) * counts[2] + index[x]);
        }};
    ISOSCOPE_ASSIGN_OR_RETURN(arrays[skipped], OpenStoredArray(store, std::move(spec)));
  }
  SourceInfo stored = info;
  stored.type = SampleTypeOf(table->type.type).stored;
  return AsVolume(info, table->type.type,
                  std::make_unique<ChunkBoxes>(std::move(stored), table, std::move(arrays)));
}

// The two readers of boxes; the first may be null.
struct BoxReaders {
  std::unique_ptr<VolumeSource> own;
  std::unique_ptr<VolumeSource> library;
};

absl::StatusOr<BoxReaders> OpenReaders(const SourceInfo& info, const WalledDataset& dataset) {
  Hdf5ChunkTable table;
  bool is_complete = false;
  while (!is_complete) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> texts,
                              DescribeWalled(dataset.library, dataset.path,
                                             absl::StrCat(dataset.part, " ", table.chunks.size())));
    if (texts.empty() && table.dims.empty()) {
      break;
    }
    // What an address sends leads to no file of this machine.
    if (!AddHdf5Chunks(texts, &table, &is_complete) ||
        (io::IsAddressText(dataset.path) && !absl::StartsWith(dataset.path, table.file))) {
      return NoSense(info);
    }
  }
  math::Index3 box_dims{0, kRowBoxEdge, kRowBoxEdge};
  if (!table.chunk_dims.empty()) {
    box_dims.y = table.chunk_dims[table.space[1]];
    box_dims.z = table.chunk_dims[table.space[0]];
  }
  BoxReaders readers{.own = nullptr,
                     .library = std::make_unique<RowBoxes>(info, dataset, box_dims)};
  if (table.layout == Hdf5Storage::kPlain) {
    ISOSCOPE_ASSIGN_OR_RETURN(readers.own, OpenPlain(info, table));
  } else if (table.layout == Hdf5Storage::kChunks) {
    ISOSCOPE_ASSIGN_OR_RETURN(readers.own, OpenChunks(info, std::move(table)));
  }
  return readers;
}

class BoxedSource final : public VolumeSource {
 public:
  BoxedSource(std::unique_ptr<VolumeSource> rows, WalledDataset dataset)
      : VolumeSource(rows->info()), dataset_(std::move(dataset)), rows_(std::move(rows)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const base::MutexLock lock(&rows_mutex_);
    if (rows_ == nullptr) {
      ISOSCOPE_ASSIGN_OR_RETURN(rows_, OpenRows(info(), dataset_));
    }
    return rows_->ReadRows(begin_row, end_row, out);
  }

  // Whoever reads a box gets the error.
  [[nodiscard]] std::optional<BoxGrid> box_grid() const override {
    const auto readers = Readers();
    if (!readers.ok()) {
      return BoxGrid{.box_dims = {kRowBoxEdge, kRowBoxEdge, kRowBoxEdge}};
    }
    const VolumeSource* const own = (*readers)->own.get();
    return own != nullptr ? own->box_grid() : (*readers)->library->box_grid();
  }
  [[nodiscard]] std::int64_t decoding_factor() const override {
    const auto readers = Readers();
    return readers.ok() && (*readers)->own != nullptr ? (*readers)->own->decoding_factor() : 1;
  }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& cancellation) const override {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const BoxReaders> readers, Readers());
    if (readers->own == nullptr) {
      return readers->library->ReadBox(box, out, cancellation);
    }
    absl::Status status = readers->own->ReadBox(box, out, cancellation);
    // The library takes some bytes that are not quite right, as those behind a stream of gzip.
    return absl::IsDataLoss(status) && readers->library->ReadBox(box, out, cancellation).ok()
               ? absl::OkStatus()
               : status;
  }

 private:
  using Opened = absl::StatusOr<std::shared_ptr<const BoxReaders>>;

  [[nodiscard]] Opened Readers() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (!readers_.has_value()) {
      absl::StatusOr<BoxReaders> opened = OpenReaders(info(), dataset_);
      if (!opened.ok() && !absl::IsDataLoss(opened.status()) &&
          !absl::IsInvalidArgument(opened.status())) {
        return opened.status();  // the next one tries again
      }
      {
        // Whoever reads boxes seldom reads rows, and their child keeps memory that this process has
        // written to since.
        const base::MutexLock rows_lock(&rows_mutex_);
        rows_ = nullptr;
      }
      readers_ = opened.ok() ? Opened(std::make_shared<const BoxReaders>(*std::move(opened)))
                             : Opened(opened.status());
    }
    return *readers_;
  }

  const WalledDataset dataset_;
  mutable base::Mutex rows_mutex_;
  // Null after the first box, until the next row.
  mutable std::unique_ptr<VolumeSource> rows_ ABSL_GUARDED_BY(rows_mutex_);
  mutable base::Mutex mutex_;  // held while a child lists the chunks; before rows_mutex_
  mutable std::optional<Opened> readers_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace

std::unique_ptr<VolumeSource> WithHdf5Boxes(std::unique_ptr<VolumeSource> rows,
                                            const WalledLibrary& library, const std::string& path,
                                            const std::string& part) {
  return std::make_unique<BoxedSource>(
      std::move(rows), WalledDataset{.library = library, .path = path, .part = part});
}

}  // namespace isoscope::source
