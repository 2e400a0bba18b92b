#include "core/source/vti_source.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <map>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/byte_order.h"
#include "expat.h"
#include "zlib.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxHeaderBytes = 64 * base::kMiB;  // of XML before the samples
constexpr std::int64_t kMaxBlockBytes = 64 * base::kMiB;   // of compressed data, decoded
constexpr std::int64_t kMaxBlocks = std::int64_t{1} << 26;

using Attributes = std::map<std::string, std::string>;

// What the XML says, up to the samples.
struct VtiHeader {
  bool is_image = false;
  Attributes file;
  Attributes image;
  Attributes array;  // the chosen DataArray
  std::string scalars;
  int piece_count = 0;
  std::string piece_extent;
  std::string encoding;              // of the appended data
  std::int64_t inline_start = -1;    // behind the tag of the chosen array
  std::int64_t appended_start = -1;  // behind the tag <AppendedData>
};

// Streams the file through expat until the samples are found.
class HeaderParser {
 public:
  HeaderParser() : parser_(XML_ParserCreate(nullptr)) {
    ISOSCOPE_CHECK(parser_ != nullptr);
    XML_SetUserData(parser_, this);
    XML_SetElementHandler(parser_, &HeaderParser::OnStart, &HeaderParser::OnEnd);
  }
  ~HeaderParser() { XML_ParserFree(parser_); }
  HeaderParser(const HeaderParser&) = delete;
  HeaderParser& operator=(const HeaderParser&) = delete;

  absl::StatusOr<VtiHeader> Parse(const io::RandomAccessFile& file) {
    std::string buffer(static_cast<std::size_t>(64 * base::kKiB), '\0');
    std::int64_t offset = 0;
    while (!is_done_ && offset < file.size_bytes()) {
      if (offset > kMaxHeaderBytes && header_.array.empty()) {
        return absl::InvalidArgumentError(absl::StrFormat("%s: no point data in the first %d bytes",
                                                          file.path(), kMaxHeaderBytes));
      }
      const auto size = static_cast<std::size_t>(
          std::min(file.size_bytes() - offset, static_cast<std::int64_t>(buffer.size())));
      ISOSCOPE_RETURN_IF_ERROR(file.ReadAt(offset, size, buffer.data()));
      offset += static_cast<std::int64_t>(size);
      if (XML_Parse(parser_, buffer.data(), static_cast<int>(size),
                    offset == file.size_bytes() ? 1 : 0) == XML_STATUS_ERROR &&
          !is_done_) {
        return absl::InvalidArgumentError(
            absl::StrFormat("%s: line %d: %s: no VTK ImageData file, or it is cut", file.path(),
                            static_cast<std::int64_t>(XML_GetCurrentLineNumber(parser_)),
                            XML_ErrorString(XML_GetErrorCode(parser_))));
      }
    }
    return header_;
  }

 private:
  static void XMLCALL OnStart(void* self, const XML_Char* name, const XML_Char** attributes) {
    Attributes map;
    for (; attributes[0] != nullptr; attributes += 2) {
      map[attributes[0]] = attributes[1];
    }
    static_cast<HeaderParser*>(self)->Start(name, std::move(map));
  }
  static void XMLCALL OnEnd(void* self, const XML_Char* name) {
    auto* const parser = static_cast<HeaderParser*>(self);
    if (std::strcmp(name, "PointData") == 0) {
      parser->is_in_point_data_ = false;
    }
  }

  void Start(const std::string& name, Attributes attributes) {
    if (name == "VTKFile") {
      header_.file = std::move(attributes);
    } else if (name == "ImageData") {
      header_.is_image = true;
      header_.image = std::move(attributes);
    } else if (name == "Piece") {
      ++header_.piece_count;
      header_.piece_extent = attributes["Extent"];
    } else if (name == "PointData") {
      is_in_point_data_ = header_.piece_count == 1;
      header_.scalars = attributes["Scalars"];
    } else if (name == "DataArray" && is_in_point_data_) {
      if (header_.array.empty() ||
          (attributes["Name"] == header_.scalars && header_.array["Name"] != header_.scalars)) {
        header_.array = std::move(attributes);
        header_.inline_start = EndOfTag();
        // Inline data may be large and need not be looked through.
        if (header_.array["format"] != "appended" &&
            (header_.scalars.empty() || header_.array["Name"] == header_.scalars)) {
          Stop();
        }
      }
    } else if (name == "AppendedData") {
      header_.encoding = attributes["encoding"];
      header_.appended_start = EndOfTag();
      Stop();  // what follows need not be XML
    }
  }

  [[nodiscard]] std::int64_t EndOfTag() const {
    return static_cast<std::int64_t>(XML_GetCurrentByteIndex(parser_)) +
           XML_GetCurrentByteCount(parser_);
  }
  void Stop() {
    is_done_ = true;
    XML_StopParser(parser_, XML_FALSE);
  }

  XML_Parser parser_;
  VtiHeader header_;
  bool is_in_point_data_ = false;
  bool is_done_ = false;
};

// Bytes in a file, as they are or as base64 text from `start`.
class EncodedBytes {
 public:
  EncodedBytes(const io::RandomAccessFile* file, std::int64_t start, bool is_base64)
      : file_(file), start_(start), is_base64_(is_base64) {}

  // Where bytes begin that are encoded anew behind the first `size` bytes.
  [[nodiscard]] EncodedBytes Behind(std::int64_t size) const {
    return {file_, start_ + (is_base64_ ? (size + 2) / 3 * 4 : size), is_base64_};
  }
  // Bytes that the rest of the file can hold at most.
  [[nodiscard]] std::int64_t MaxSize() const {
    const std::int64_t rest = std::max<std::int64_t>(file_->size_bytes() - start_, 0);
    return is_base64_ ? rest / 4 * 3 : rest;
  }
  [[nodiscard]] std::int64_t start() const { return start_; }

  absl::Status ReadAt(std::int64_t offset, std::size_t size, char* out) const {
    if (!is_base64_) {
      return file_->ReadAt(start_ + offset, size, out);
    }
    constexpr std::size_t kGroups = 4096;
    std::array<char, 4 * kGroups> text;
    auto skip = static_cast<std::size_t>(offset % 3);
    std::int64_t position = start_ + offset / 3 * 4;
    while (size > 0) {
      const std::size_t groups = std::min(kGroups, (skip + size + 2) / 3);
      ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(position, 4 * groups, text.data()));
      for (std::size_t group = 0; group < groups && size > 0; ++group) {
        std::array<char, 3> bytes{};
        const std::size_t count = Decode(text.data() + 4 * group, bytes.data());
        const std::size_t take = std::min(size, count - std::min(count, skip));
        if (take == 0) {
          return absl::DataLossError(
              absl::StrFormat("%s: no base64 text at byte %d", file_->path(),
                              position + 4 * static_cast<std::int64_t>(group)));
        }
        out = std::copy_n(bytes.data() + skip, take, out);
        size -= take;
        skip = 0;
      }
      position += static_cast<std::int64_t>(4 * groups);
    }
    return absl::OkStatus();
  }

 private:
  static int ValueOf(char c) {
    if (c >= 'A' && c <= 'Z') {
      return c - 'A';
    }
    if (c >= 'a' && c <= 'z') {
      return c - 'a' + 26;
    }
    if (c >= '0' && c <= '9') {
      return c - '0' + 52;
    }
    return c == '+' ? 62 : c == '/' ? 63 : -1;
  }
  // Four characters to up to three bytes; returns how many.
  static std::size_t Decode(const char* text, char* out) {
    std::array<int, 4> values;
    std::transform(text, text + 4, values.begin(), ValueOf);
    const std::size_t count = values[0] < 0 || values[1] < 0 ? 0
                              : values[2] < 0                ? (text[2] == '=' ? 1 : 0)
                              : values[3] < 0                ? (text[3] == '=' ? 2 : 0)
                                                             : 3;
    const int bits = std::max(values[0], 0) << 18 | std::max(values[1], 0) << 12 |
                     std::max(values[2], 0) << 6 | std::max(values[3], 0);
    out[0] = static_cast<char>(bits >> 16 & 0xff);
    out[1] = static_cast<char>(bits >> 8 & 0xff);
    out[2] = static_cast<char>(bits & 0xff);
    return count;
  }

  const io::RandomAccessFile* file_;
  std::int64_t start_;
  bool is_base64_;
};

// How the samples are stored in blocks: one for all, or compressed ones.
struct Blocks {
  std::int64_t block_bytes = 0;       // decoded, of each block but the last
  std::vector<std::int64_t> offsets;  // of each compressed block, and the end; empty: plain
};

class VtiSource final : public VolumeSource {
 public:
  VtiSource(const volume::GridGeometry& geometry, volume::ScalarType type, bool is_big_endian,
            std::unique_ptr<io::RandomAccessFile> file, const EncodedBytes& data, Blocks blocks,
            std::int64_t skipped_bytes = 0)
      : geometry_(geometry),
        type_(type),
        is_big_endian_(is_big_endian),
        file_(std::move(file)),
        data_(data),
        blocks_(std::move(blocks)),
        skipped_bytes_(skipped_bytes) {}

  [[nodiscard]] const volume::GridGeometry& geometry() const override { return geometry_; }
  [[nodiscard]] volume::ScalarType scalar_type() const override { return type_; }
  [[nodiscard]] const std::string& name() const override { return file_->path(); }
  [[nodiscard]] std::int64_t memory_bytes() const override {
    return 64 * base::kKiB + 2 * blocks_.block_bytes +
           static_cast<std::int64_t>(blocks_.offsets.size() * sizeof(std::int64_t));
  }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = geometry_.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    const std::int64_t row_bytes = dims.x * static_cast<std::int64_t>(volume::SizeOf(type_));
    const std::int64_t begin = begin_row * row_bytes;
    const std::int64_t end = end_row * row_bytes;
    if (blocks_.offsets.empty()) {
      ISOSCOPE_RETURN_IF_ERROR(
          data_.ReadAt(skipped_bytes_ + begin, static_cast<std::size_t>(end - begin), out));
    } else {
      char* next = out;
      for (std::int64_t at = begin; at < end;) {
        const std::int64_t block = at / blocks_.block_bytes;
        ISOSCOPE_RETURN_IF_ERROR(Inflate(block));
        const std::int64_t first = block * blocks_.block_bytes;
        const std::int64_t stop = std::min(end, first + static_cast<std::int64_t>(decoded_.size()));
        next = std::copy(decoded_.begin() + (at - first), decoded_.begin() + (stop - first), next);
        at = stop;
      }
    }
    if (is_big_endian_) {
      SwapBytes(volume::SizeOf(type_),
                static_cast<std::size_t>(end - begin) / volume::SizeOf(type_), out);
    }
    return absl::OkStatus();
  }

 private:
  // Decodes a block into decoded_.
  absl::Status Inflate(std::int64_t block) {
    if (block == held_) {
      return absl::OkStatus();
    }
    held_ = -1;
    const auto at = static_cast<std::size_t>(block);
    const std::int64_t total =
        math::Volume(geometry_.sample_dims) * static_cast<std::int64_t>(volume::SizeOf(type_));
    decoded_.resize(static_cast<std::size_t>(
        std::min(blocks_.block_bytes, total - block * blocks_.block_bytes)));
    encoded_.resize(static_cast<std::size_t>(blocks_.offsets[at + 1] - blocks_.offsets[at]));
    ISOSCOPE_RETURN_IF_ERROR(data_.ReadAt(blocks_.offsets[at], encoded_.size(), encoded_.data()));
    auto size = static_cast<uLongf>(decoded_.size());
    const int result = uncompress(reinterpret_cast<Bytef*>(decoded_.data()), &size,
                                  reinterpret_cast<const Bytef*>(encoded_.data()),
                                  static_cast<uLong>(encoded_.size()));
    if (result != Z_OK || size != decoded_.size()) {
      return absl::DataLossError(absl::StrFormat(
          "%s: compressed block %d of %d is damaged: %d of %d bytes, zlib error %d", file_->path(),
          block, blocks_.offsets.size() - 1, size, decoded_.size(), result));
    }
    held_ = block;
    return absl::OkStatus();
  }

  const volume::GridGeometry geometry_;
  const volume::ScalarType type_;
  const bool is_big_endian_;
  const std::unique_ptr<io::RandomAccessFile> file_;
  const EncodedBytes data_;
  const Blocks blocks_;
  const std::int64_t skipped_bytes_;  // of data_, before samples that are not compressed
  std::int64_t held_ = -1;            // the block in decoded_
  std::vector<char> decoded_;
  std::vector<char> encoded_;
};

// `count` numbers in `text`.
template <typename T>
absl::StatusOr<std::vector<T>> ParseNumbers(const std::string& text, std::size_t count,
                                            const char* what, const std::string& path) {
  std::vector<T> numbers;
  for (const absl::string_view part :
       absl::StrSplit(text, absl::ByAnyChar(" \t\r\n"), absl::SkipEmpty())) {
    T number{};
    bool is_number = false;
    if constexpr (std::is_same_v<T, double>) {
      is_number = absl::SimpleAtod(part, &number);
    } else {
      is_number = absl::SimpleAtoi(part, &number);
    }
    if (!is_number) {
      break;
    }
    numbers.push_back(number);
  }
  if (numbers.size() != count) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %s=\"%s\"; expected %d numbers", path, what, text, count));
  }
  return numbers;
}

absl::StatusOr<volume::GridGeometry> GeometryOf(const VtiHeader& header, const std::string& path) {
  const auto get = [&](const char* name, const char* fallback) {
    const auto found = header.image.find(name);
    return found == header.image.end() ? std::string(fallback) : found->second;
  };
  const std::string extent_text = get("WholeExtent", "");
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> extent,
                            ParseNumbers<std::int64_t>(extent_text, 6, "WholeExtent", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> piece,
                            ParseNumbers<std::int64_t>(header.piece_extent, 6, "Extent", path));
  if (piece != extent) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: its first piece is %s of %s; expected the whole image in one piece",
                        path, header.piece_extent, extent_text));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> origin,
                            ParseNumbers<double>(get("Origin", "0 0 0"), 3, "Origin", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> spacing,
                            ParseNumbers<double>(get("Spacing", "1 1 1"), 3, "Spacing", path));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<double> direction,
      ParseNumbers<double>(get("Direction", "1 0 0 0 1 0 0 0 1"), 9, "Direction", path));
  volume::GridGeometry geometry;
  constexpr std::int64_t kMaxIndex = std::numeric_limits<std::int32_t>::max();  // VTK's own
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    if (std::abs(extent[2 * a]) > kMaxIndex || std::abs(extent[2 * a + 1]) > kMaxIndex) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: WholeExtent=\"%s\"; expected 32-bit numbers", path, extent_text));
    }
    geometry.sample_dims[axis] = extent[2 * a + 1] - extent[2 * a] + 1;
    geometry.spacing[axis] = spacing[a];
    geometry.direction.columns[a] = {direction[a], direction[3 + a], direction[6 + a]};
  }
  geometry.origin = {origin[0], origin[1], origin[2]};
  for (std::size_t a = 0; a < 3; ++a) {  // VTK's origin is that of index 0
    geometry.origin = geometry.origin + geometry.direction.columns[a] *
                                            (spacing[a] * static_cast<double>(extent[2 * a]));
  }
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
  }
  return geometry;
}

absl::StatusOr<volume::ScalarType> TypeOf(VtiHeader* header, const std::string& path) {
  static constexpr struct {
    const char* name;
    volume::ScalarType type;
  } kTypes[] = {
      {"UInt8", volume::ScalarType::kUint8},     {"Int8", volume::ScalarType::kInt8},
      {"UInt16", volume::ScalarType::kUint16},   {"Int16", volume::ScalarType::kInt16},
      {"UInt32", volume::ScalarType::kUint32},   {"Int32", volume::ScalarType::kInt32},
      {"Float32", volume::ScalarType::kFloat32}, {"Float64", volume::ScalarType::kFloat64}};
  const std::string components = header->array["NumberOfComponents"];
  if (!components.empty() && components != "1") {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: array \"%s\" has %s components; expected 1", path, header->array["Name"], components));
  }
  for (const auto& row : kTypes) {
    if (header->array["type"] == row.name) {
      return row.type;
    }
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: array \"%s\" is of type \"%s\"; expected (U)Int8, (U)Int16, (U)Int32, Float32 or "
      "Float64",
      path, header->array["Name"], header->array["type"]));
}

// Where the array's bytes begin.
absl::StatusOr<EncodedBytes> FindData(VtiHeader* header, const io::RandomAccessFile& file) {
  const std::string& format = header->array["format"];
  const bool is_appended = format == "appended";
  if (!is_appended && format != "binary") {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: data format \"%s\"; expected appended or binary: write the file anew without text "
        "(ascii) data",
        file.path(), format));
  }
  std::int64_t position = is_appended ? header->appended_start : header->inline_start;
  if (position < 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(file.path(), ": no AppendedData: the file is cut"));
  }
  // White space, and for appended data the underscore that begins it.
  constexpr std::int64_t kMaxSpace = 4096;
  const std::int64_t limit = std::min(position + kMaxSpace, file.size_bytes());
  char c = ' ';
  for (; position < limit; ++position) {
    ISOSCOPE_RETURN_IF_ERROR(file.ReadAt(position, 1, &c));
    if (!absl::ascii_isspace(static_cast<unsigned char>(c))) {
      break;
    }
  }
  if (!is_appended) {
    return EncodedBytes(&file, position, true);
  }
  if (c != '_') {
    return absl::InvalidArgumentError(
        absl::StrCat(file.path(), ": no '_' at the start of AppendedData: the file is cut"));
  }
  if (header->encoding != "raw" && header->encoding != "base64") {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: encoding \"%s\" of AppendedData; expected raw or base64", file.path(),
                        header->encoding));
  }
  std::int64_t offset = 0;
  if (!absl::SimpleAtoi(header->array["offset"], &offset) || offset < 0 ||
      offset > file.size_bytes()) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: offset=\"%s\" in %d bytes of file",
                                                      file.path(), header->array["offset"],
                                                      file.size_bytes()));
  }
  return EncodedBytes(&file, position + 1 + offset, header->encoding == "base64");
}

// Reads the numbers, of 4 or 8 bytes each, that stand before the samples.
class LengthReader {
 public:
  LengthReader(std::size_t number_size, bool is_big_endian, const EncodedBytes& bytes)
      : number_size_(number_size), is_big_endian_(is_big_endian), bytes_(bytes) {}

  [[nodiscard]] std::int64_t SizeOf(std::int64_t count) const {
    return count * static_cast<std::int64_t>(number_size_);
  }
  // Numbers [first, first + count). Those beyond int64 come out negative.
  [[nodiscard]] absl::StatusOr<std::vector<std::int64_t>> Read(std::int64_t first,
                                                               std::int64_t count) const {
    if (SizeOf(first + count) > bytes_.MaxSize()) {
      return absl::InvalidArgumentError(
          "the file ends within the sizes before its samples: it is "
          "cut");
    }
    std::string text(static_cast<std::size_t>(SizeOf(count)), '\0');
    ISOSCOPE_RETURN_IF_ERROR(bytes_.ReadAt(SizeOf(first), text.size(), text.data()));
    if (is_big_endian_) {
      SwapBytes(number_size_, static_cast<std::size_t>(count), text.data());
    }
    std::vector<std::int64_t> numbers(static_cast<std::size_t>(count));
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      const char* at = text.data() + i * number_size_;
      numbers[i] = number_size_ == 4 ? std::int64_t{base::LoadLittleEndian<std::uint32_t>(at)}
                                     : base::LoadLittleEndian<std::int64_t>(at);
    }
    return numbers;
  }

 private:
  const std::size_t number_size_;
  const bool is_big_endian_;
  const EncodedBytes bytes_;
};

// The table of compressed blocks: their number, decoded size, that of the last one (0: as the
// others), and each one's compressed size.
absl::StatusOr<Blocks> ReadBlockTable(const LengthReader& lengths, std::int64_t expected_bytes,
                                      std::int64_t max_bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> head, lengths.Read(0, 3));
  const std::int64_t count = head[0];
  const std::int64_t block_bytes = head[1];
  const std::int64_t last_bytes = head[2] == 0 ? block_bytes : head[2];
  if (count < 1 || count > kMaxBlocks || block_bytes < 1 || block_bytes > kMaxBlockBytes ||
      last_bytes < 1 || last_bytes > block_bytes ||
      (count - 1) * block_bytes + last_bytes != expected_bytes) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d compressed blocks of %d bytes, the last of %d; expected %d bytes in all, blocks of at "
        "most %d",
        count, block_bytes, last_bytes, expected_bytes, kMaxBlockBytes));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> sizes, lengths.Read(3, count));
  Blocks blocks;
  blocks.block_bytes = block_bytes;
  blocks.offsets.reserve(sizes.size() + 1);
  blocks.offsets.push_back(0);
  for (const std::int64_t size : sizes) {
    // zlib never makes a block much larger.
    if (size < 1 || size > block_bytes + block_bytes / 8 + 1024 ||
        blocks.offsets.back() + size > max_bytes) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "compressed block %d of %d: %d bytes at %d, where %d are left in the file: it is cut or "
          "damaged",
          blocks.offsets.size() - 1, count, size, blocks.offsets.back(),
          max_bytes - blocks.offsets.back()));
    }
    blocks.offsets.push_back(blocks.offsets.back() + size);
  }
  return blocks;
}

absl::Status Named(const std::string& path, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(path, ": ", status.message()));
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVtiFile(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  ISOSCOPE_ASSIGN_OR_RETURN(VtiHeader header, HeaderParser().Parse(*file));
  if (!header.is_image || header.piece_count < 1 || header.array.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": no ImageData with an array in its PointData"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry, GeometryOf(header, path));
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::ScalarType type, TypeOf(&header, path));
  if (math::Volume(geometry.sample_dims) > std::numeric_limits<std::int64_t>::max() / 16) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": more samples than any file holds"));
  }
  const std::int64_t sample_bytes =
      math::Volume(geometry.sample_dims) * static_cast<std::int64_t>(volume::SizeOf(type));
  const bool is_big_endian = header.file["byte_order"] == "BigEndian";
  const std::string& compressor = header.file["compressor"];
  if (!compressor.empty() && compressor != "vtkZLibDataCompressor") {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: compressor \"%s\"; expected vtkZLibDataCompressor, or none", path, compressor));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const EncodedBytes bytes, FindData(&header, *file));
  const LengthReader lengths(header.file["header_type"] == "UInt64" ? 8 : 4, is_big_endian, bytes);
  if (!compressor.empty()) {
    // The table is encoded by itself; its size stands at its start.
    const auto count = lengths.Read(0, 1);
    if (!count.ok()) {
      return Named(path, count.status());
    }
    const std::int64_t blocks_at_most = std::clamp<std::int64_t>((*count)[0], 0, kMaxBlocks);
    const EncodedBytes data = bytes.Behind(lengths.SizeOf(3 + blocks_at_most));
    absl::StatusOr<Blocks> blocks = ReadBlockTable(lengths, sample_bytes, data.MaxSize());
    if (!blocks.ok()) {
      return Named(path, blocks.status());
    }
    return std::make_unique<VtiSource>(geometry, type, is_big_endian, std::move(file), data,
                                       *std::move(blocks));
  }
  const auto size = lengths.Read(0, 1);
  if (!size.ok()) {
    return Named(path, size.status());
  }
  const std::int64_t header_bytes = lengths.SizeOf(1);
  // With a header of 32 bits VTK writes sizes of 4 GiB and more without their upper bits.
  const bool fits =
      header_bytes == 8 ? (*size)[0] == sample_bytes : (*size)[0] == (sample_bytes & 0xffffffff);
  if (!fits || bytes.MaxSize() - header_bytes < sample_bytes) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d x %d x %d samples of %s need %d bytes, the array says %d and the file has room for "
        "%d",
        path, geometry.sample_dims.x, geometry.sample_dims.y, geometry.sample_dims.z,
        volume::NameOf(type), sample_bytes, (*size)[0],
        std::max<std::int64_t>(bytes.MaxSize() - header_bytes, 0)));
  }
  // One run of text or bytes: the size, then the samples.
  return std::make_unique<VtiSource>(geometry, type, is_big_endian, std::move(file), bytes,
                                     Blocks{}, header_bytes);
}

}  // namespace isoscope::source
