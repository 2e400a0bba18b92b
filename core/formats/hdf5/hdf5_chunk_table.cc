// The texts:
//
//   layout=chunks            or "plain", "other"
//   file=/data/run.h5
//   dims=50 64 64 64         of the dataset
//   chunk=1 32 32 32         of a dataset in chunks
//   space=1 2 3              its axes z, y and x
//   start=3 0 0 0            the index on all other axes
//   type=>i2                 as NumPy writes it
//   offset=4096              of "plain"
//   filter=2 2               number, then parameters; once for each filter
//   fill=0000                bytes of an element of a chunk that was never written
//   chunks=1000 1a4 0,-,...  hexadecimal: offset, size, filters that were left out; "-": never
//                            written
//
// A list of chunks that does not fit into one answer goes on in the next one, which has the last line
// alone. A dataset is "other" if its elements are not numbers of all their bits, if it lies in other
// files, or if nothing was written to it. Chunks may have several steps or components: those that have
// the volume's are listed.

#include "core/formats/hdf5/hdf5_chunk_table.h"

#include <algorithm>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"
#include "core/source/hdf5/hdf5_chunk_finder.h"
#include "core/source/hdf5/hdf5_file_lookup.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

// Some 24 bytes of text each, and half a second of look-ups.
constexpr std::int64_t kChunksInAnswer = 200'000;
constexpr std::size_t kMaxFilters = 32;
constexpr std::size_t kMaxFilterValues = 64;
// Numbers of the product of sizes, which must not overflow.
constexpr std::int64_t kMaxElements = std::int64_t{1} << 60;

// ---- The child. ---------------------------------------------------------------------------------

// "<i2"; "" if the library does more with the elements than to swap their bytes.
std::string NumpyTypeOf(hid_t dataset, const Hdf5SampleType& type) {
  Hdf5Handle stored(H5Dget_type(dataset), H5Tclose);
  if (H5Tget_class(stored.get()) == H5T_ENUM) {
    stored = Hdf5Handle(H5Tget_super(stored.get()), H5Tclose);
  }
  const H5T_order_t order = H5Tget_order(stored.get());
  const Hdf5Handle little(H5Tcopy(stored.get()), H5Tclose);
  if ((order != H5T_ORDER_LE && order != H5T_ORDER_BE) ||
      H5Tset_order(little.get(), H5T_ORDER_LE) < 0 ||
      H5Tequal(little.get(), type.memory_type.get()) <= 0) {
    return "";
  }
  static const auto* const letters = new std::map<volume::ScalarType, std::string>{
      {volume::ScalarType::kUint8, "u1"},   {volume::ScalarType::kInt8, "i1"},
      {volume::ScalarType::kUint16, "u2"},  {volume::ScalarType::kInt16, "i2"},
      {volume::ScalarType::kUint32, "u4"},  {volume::ScalarType::kInt32, "i4"},
      {volume::ScalarType::kFloat32, "f4"}, {volume::ScalarType::kFloat64, "f8"}};
  static const auto* const wide = new std::map<WideType, std::string>{
      {WideType::kInt64, "i8"}, {WideType::kUint64, "u8"}, {WideType::kFloat16, "f2"}};
  return absl::StrCat(order == H5T_ORDER_BE ? ">" : "<",
                      type.wide.has_value() ? wide->at(*type.wide) : letters->at(type.scalar));
}

// An element of the dataset as it is read: bytes that nobody wrote are 0.
absl::StatusOr<std::string> ElementAt(hid_t dataset, const Hdf5SampleType& type,
                                      const std::vector<hsize_t>& index, const std::string& name) {
  std::string element(H5Tget_size(type.memory_type.get()), '\0');
  const std::vector<hsize_t> one(index.size(), 1);
  const Hdf5Handle space(H5Dget_space(dataset), H5Sclose);
  const Hdf5Handle memory(H5Screate_simple(static_cast<int>(one.size()), one.data(), nullptr),
                          H5Sclose);
  if (H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, index.data(), nullptr, one.data(), nullptr) <
          0 ||
      H5Dread(dataset, type.memory_type.get(), memory.get(), space.get(), H5P_DEFAULT,
              element.data()) < 0) {
    return absl::DataLossError(absl::StrCat(name, ": can't be read: ", LastHdf5Error()));
  }
  return element;
}

std::vector<std::string> FilterTexts(hid_t properties) {
  std::vector<std::string> texts;
  const int count = H5Pget_nfilters(properties);
  for (int i = 0; i < count; ++i) {
    unsigned int flags = 0;
    unsigned int config = 0;
    std::size_t value_count = kMaxFilterValues;
    std::array<unsigned int, kMaxFilterValues> values{};
    std::array<char, 2> name{};
    const H5Z_filter_t id =
        H5Pget_filter2(properties, static_cast<unsigned int>(i), &flags, &value_count,
                       values.data(), name.size(), name.data(), &config);
    texts.push_back(absl::StrCat("filter=", id));
    for (std::size_t value = 0; value < std::min(value_count, values.size()); ++value) {
      absl::StrAppend(&texts.back(), " ", values[value]);
    }
  }
  return texts;
}

// The lists of chunks, and the fill value if one is missing.
class ChunkList {
 public:
  ChunkList(const NamedHdf5Dataset& named, const Hdf5SampleType& type, const Hdf5ChunkTable& table,
            bool are_edges_plain)
      : named_(named), type_(type), table_(table), are_edges_plain_(are_edges_plain) {}

  absl::Status Add(std::int64_t first, std::vector<std::string>* texts) {
    const std::string name = named_.parts.name();
    const auto [depth, height, width] = table_.counts();
    ISOSCOPE_ASSIGN_OR_RETURN(Hdf5ChunkFinder finder,
                              Hdf5ChunkFinder::Open(named_.dataset.get(), name));
    std::string chunks = "chunks=";
    std::optional<std::vector<hsize_t>> missing;
    const std::int64_t end = std::min(first + kChunksInAnswer, depth * height * width);
    for (std::int64_t number = first; number < end; ++number) {
      const std::vector<hsize_t> corner =
          CornerOf({number / width / height, number / width % height, number % width});
      ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<Hdf5Chunk> chunk, finder.Find(corner));
      absl::StrAppend(&chunks, number == first ? "" : ",");
      if (!chunk.has_value()) {
        missing = corner;
        absl::StrAppend(&chunks, "-");
      } else {
        const bool is_plain = are_edges_plain_ && IsAtEdge(corner);
        absl::StrAppend(&chunks, absl::Hex(chunk->offset), " ", absl::Hex(chunk->size), " ",
                        absl::Hex(is_plain ? std::numeric_limits<std::uint32_t>::max()
                                           : chunk->skipped_filters));
      }
    }
    if (missing.has_value()) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::string fill,
                                ElementAt(named_.dataset.get(), type_, *missing, name));
      texts->push_back(absl::StrCat("fill=", absl::BytesToHexString(fill)));
    }
    texts->push_back(std::move(chunks));
    return absl::OkStatus();
  }

 private:
  // The first element of a chunk of the volume.
  [[nodiscard]] std::vector<hsize_t> CornerOf(const std::array<std::int64_t, 3>& chunk) const {
    std::vector<hsize_t> corner(table_.start.size());
    for (std::size_t axis = 0; axis < corner.size(); ++axis) {
      const std::int64_t size = table_.chunk_dims[axis];
      const std::int64_t first = table_.start[axis] / size * size;
      corner[axis] = static_cast<hsize_t>(first);
    }
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t axis = table_.space[i];
      const std::int64_t first = chunk[i] * table_.chunk_dims[axis];
      corner[axis] = static_cast<hsize_t>(first);
    }
    return corner;
  }
  [[nodiscard]] bool IsAtEdge(const std::vector<hsize_t>& corner) const {
    for (std::size_t axis = 0; axis < corner.size(); ++axis) {
      if (static_cast<std::int64_t>(corner[axis]) + table_.chunk_dims[axis] > table_.dims[axis]) {
        return true;
      }
    }
    return false;
  }

  const NamedHdf5Dataset& named_;
  const Hdf5SampleType& type_;
  const Hdf5ChunkTable& table_;
  const bool are_edges_plain_;  // chunks that reach beyond the dataset have no filters
};

// ---- The parent. --------------------------------------------------------------------------------

bool ParseIntegers(absl::string_view text, std::int64_t least, std::size_t max_count,
                   std::vector<std::int64_t>* numbers) {
  numbers->clear();
  for (const absl::string_view word : absl::StrSplit(text, ' ', absl::SkipEmpty())) {
    if (numbers->size() == max_count || !absl::SimpleAtoi(word, &numbers->emplace_back()) ||
        numbers->back() < least) {
      return false;
    }
  }
  return true;
}

bool ParseSpace(absl::string_view text, std::array<std::size_t, 3>* space) {
  std::vector<std::int64_t> axes;
  if (!ParseIntegers(text, 0, 3, &axes) || axes.size() != 3) {
    return false;
  }
  std::transform(axes.begin(), axes.end(), space->begin(),
                 [](std::int64_t axis) { return static_cast<std::size_t>(axis); });
  return true;
}

bool ParseLayout(absl::string_view text, Hdf5Storage* layout) {
  *layout = text == "chunks"  ? Hdf5Storage::kChunks
            : text == "plain" ? Hdf5Storage::kPlain
                              : Hdf5Storage::kOther;
  return *layout != Hdf5Storage::kOther || text == "other";
}

bool ParseChunk(absl::string_view text, Hdf5TableChunk* chunk) {
  if (text == "-") {
    return true;
  }
  const std::vector<absl::string_view> words = absl::StrSplit(text, absl::MaxSplits(' ', 2));
  return words.size() == 3 && absl::SimpleHexAtoi(words[0], &chunk->offset) &&
         absl::SimpleHexAtoi(words[1], &chunk->size) &&
         absl::SimpleHexAtoi(words[2], &chunk->skipped_filters) && chunk->offset >= 0 &&
         chunk->size > 0;
}

bool ParseChunks(absl::string_view text, std::vector<Hdf5TableChunk>* chunks) {
  for (const absl::string_view word : absl::StrSplit(text, ',')) {
    if (static_cast<std::int64_t>(chunks->size()) == kMaxHdf5Chunks ||
        !ParseChunk(word, &chunks->emplace_back())) {
      return false;
    }
  }
  return true;
}

bool ParseFilter(absl::string_view text, Hdf5ChunkTable* table) {
  std::vector<std::int64_t> numbers;
  if (!ParseIntegers(text, 0, 1 + kMaxFilterValues, &numbers) || numbers.empty() ||
      table->filters.size() == kMaxFilters) {
    return false;
  }
  table->filters.push_back({.id = numbers.front(), .values = {numbers.begin() + 1, numbers.end()}});
  return true;
}

bool ParseTableText(absl::string_view key, absl::string_view value, Hdf5ChunkTable* table) {
  if (key == "layout") {
    return ParseLayout(value, &table->layout);
  }
  if (key == "file") {
    table->file = std::string(value);
    return !value.empty();
  }
  if (key == "dims") {
    return ParseIntegers(value, 1, kMaxChunkAxes, &table->dims);
  }
  if (key == "chunk") {
    return ParseIntegers(value, 1, kMaxChunkAxes, &table->chunk_dims);
  }
  if (key == "space") {
    return ParseSpace(value, &table->space);
  }
  if (key == "start") {
    return ParseIntegers(value, 0, kMaxChunkAxes, &table->start);
  }
  if (key == "type") {
    const auto type = ParseNumpyType(value);
    table->type = type.value_or(StoredNumber());
    return type.ok();
  }
  if (key == "offset") {
    return absl::SimpleAtoi(value, &table->plain_offset) && table->plain_offset >= 0;
  }
  if (key == "filter") {
    return ParseFilter(value, table);
  }
  if (key == "fill") {
    const bool is_hex = value.size() % 2 == 0 && value.size() <= 16 &&
                        value.find_first_not_of("0123456789abcdef") == absl::string_view::npos;
    table->fill = is_hex ? absl::HexStringToBytes(value) : "";
    return is_hex;
  }
  return key == "chunks" && ParseChunks(value, &table->chunks);
}

// True if the members fit each other.
bool MakesSense(const Hdf5ChunkTable& table) {
  const std::size_t rank = table.dims.size();
  const auto& [z, y, x] = table.space;
  if (rank < 3 || table.start.size() != rank || !(z < y && y < x && x < rank) ||
      table.file.empty() || CheckedVolume(table.dims, 8, kMaxElements) < 0 ||
      (!table.chunk_dims.empty() &&
       (table.chunk_dims.size() != rank || CheckedVolume(table.chunk_dims, 8, kMaxElements) < 0))) {
    return false;
  }
  for (std::size_t axis = 0; axis < rank; ++axis) {
    const bool is_space = axis == z || axis == y || axis == x;
    if (table.start[axis] >= (is_space ? 1 : table.dims[axis])) {
      return false;
    }
  }
  if (table.layout != Hdf5Storage::kChunks) {
    return table.chunks.empty();
  }
  return !table.chunk_dims.empty() &&
         (table.fill.empty() || table.fill.size() == SizeOf(table.type.type));
}

}  // namespace

std::array<std::int64_t, 3> Hdf5ChunkTable::counts() const {
  std::array<std::int64_t, 3> counts{};
  for (std::size_t i = 0; i < 3; ++i) {
    counts[i] = (dims[space[i]] - 1) / chunk_dims[space[i]] + 1;
  }
  return counts;
}

absl::StatusOr<std::vector<std::string>> ListHdf5Chunks(const NamedHdf5Dataset& named,
                                                        const Hdf5SampleType& type,
                                                        const AxisOrder& axes, std::int64_t step,
                                                        std::int64_t component,
                                                        std::int64_t first) {
  const hid_t dataset = named.dataset.get();
  const std::string name = named.parts.name();
  Hdf5ChunkTable table{
      .file = Hdf5FileOf(dataset), .dims = Hdf5DimsOf(dataset), .space = {axes.z, axes.y, axes.x}};
  table.start.assign(table.dims.size(), 0);
  if (axes.t.has_value()) {
    table.start[*axes.t] = step;
  }
  if (axes.c.has_value()) {
    table.start[*axes.c] = component;
  }
  const Hdf5Handle properties(H5Dget_create_plist(dataset), H5Pclose);
  const H5D_layout_t layout = H5Pget_layout(properties.get());
  const std::string numpy_type = NumpyTypeOf(dataset, type);
  unsigned int options = 0;
  if (layout == H5D_CHUNKED) {
    std::vector<hsize_t> chunk(table.dims.size());
    if (H5Pget_chunk(properties.get(), static_cast<int>(chunk.size()), chunk.data()) < 0 ||
        H5Pget_chunk_opts(properties.get(), &options) < 0) {
      return absl::DataLossError(
          absl::StrCat(name, ": its chunks can't be read: ", LastHdf5Error()));
    }
    table.chunk_dims.assign(chunk.begin(), chunk.end());
    if (!numpy_type.empty()) {
      table.layout = Hdf5Storage::kChunks;
    }
  }
  const haddr_t offset = layout == H5D_CONTIGUOUS ? H5Dget_offset(dataset) : HADDR_UNDEF;
  if (offset != HADDR_UNDEF && !numpy_type.empty() &&
      H5Pget_external_count(properties.get()) == 0) {
    table.layout = Hdf5Storage::kPlain;
  }
  std::vector<std::string> texts;
  if (first == 0) {
    texts = {absl::StrCat("layout=", table.layout == Hdf5Storage::kChunks  ? "chunks"
                                     : table.layout == Hdf5Storage::kPlain ? "plain"
                                                                           : "other"),
             absl::StrCat("file=", table.file),
             absl::StrCat("dims=", absl::StrJoin(table.dims, " ")),
             absl::StrCat("space=", absl::StrJoin(table.space, " ")),
             absl::StrCat("start=", absl::StrJoin(table.start, " "))};
    if (!table.chunk_dims.empty()) {
      texts.push_back(absl::StrCat("chunk=", absl::StrJoin(table.chunk_dims, " ")));
    }
    if (!numpy_type.empty()) {
      texts.push_back(absl::StrCat("type=", numpy_type));
    }
    if (table.layout == Hdf5Storage::kPlain) {
      texts.push_back(absl::StrCat("offset=", offset));
    }
  }
  if (table.layout != Hdf5Storage::kChunks) {
    return texts;
  }
  const auto counts = table.counts();
  const std::int64_t count = CheckedVolume({counts.begin(), counts.end()}, 1, kMaxHdf5Chunks);
  if (count < 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %s chunks; expected at most %d to read them in any order: write it with larger chunks "
        "(h5repack -l %s:CHUNK=64x64x64 IN OUT), or leave --index-only out",
        name, absl::StrJoin(counts, " x "), kMaxHdf5Chunks, named.parts.dataset));
  }
  if (first == 0) {
    const std::vector<std::string> filters = FilterTexts(properties.get());
    texts.insert(texts.end(), filters.begin(), filters.end());
  }
  if (first < count) {
    ISOSCOPE_RETURN_IF_ERROR(
        ChunkList(named, type, table, (options & H5D_CHUNK_DONT_FILTER_PARTIAL_CHUNKS) != 0)
            .Add(first, &texts));
  }
  return texts;
}

bool AddHdf5Chunks(const std::vector<std::string>& texts, Hdf5ChunkTable* table,
                   bool* is_complete) {
  const std::size_t before = table->chunks.size();
  for (const std::string& text : texts) {
    const std::pair<absl::string_view, absl::string_view> pair =
        absl::StrSplit(text, absl::MaxSplits('=', 1));
    if (!ParseTableText(pair.first, pair.second, table)) {
      return false;
    }
  }
  if (!MakesSense(*table)) {
    return false;
  }
  *is_complete = true;
  if (table->layout != Hdf5Storage::kChunks) {
    return true;
  }
  const auto counts = table->counts();
  const std::int64_t count = CheckedVolume({counts.begin(), counts.end()}, 1, kMaxHdf5Chunks);
  const auto found = static_cast<std::int64_t>(table->chunks.size());
  *is_complete = found == count;
  const bool is_missing =
      std::any_of(table->chunks.begin() + static_cast<std::ptrdiff_t>(before), table->chunks.end(),
                  [](const Hdf5TableChunk& chunk) { return chunk.size == 0; });
  // Each answer has some; else there would be no end.
  return found <= count && table->chunks.size() > before && !(is_missing && table->fill.empty());
}

}  // namespace isoscope::source
