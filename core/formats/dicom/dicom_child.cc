// Here GDCM reads files, in a child process that it may end. The questions:
//
//   kFrames    a list of frames, or of the only image, in the shared memory (dicom_frame_list.h)
//   kFrame     the pixels of one frame, as they are stored
//   kSegments  the segments of a segmentation (0062,0002): number, label, colour
//
// GDCM's readers of images end the process on some files, and do not know all classes. So headers
// are read element by element. Its reader of images is used for two things: the pixels, and the
// type of a compressed image, whose codestream may contradict the elements.
//
// Debian's GDCM refuses files of High-Throughput JPEG 2000 for their transfer syntax. So the child
// gives it their bytes with that of JPEG 2000, and OpenJPEG, which knows both, decodes them.
//
// Invariants: an answer of zeros means "not decoded", so a child that ends early gives no header.
// No text but the series UID and the labels of segments leaves the child, because texts may quote
// fields of the patient.

#include "core/formats/dicom/dicom_child.h"

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <sstream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/formats/dicom/dicom_frame_list.h"
#include "core/source/bytes/jpeg_slice.h"
#include "core/volume/scalar_type.h"
#include "gdcmBoxRegion.h"
#include "gdcmImageReader.h"
#include "gdcmImageRegionReader.h"
#include "gdcmReader.h"
#include "gdcmSequenceOfFragments.h"
#include "gdcmTrace.h"

namespace isoscope::source {
namespace {

gdcm::Tag PixelsTag() { return {0x7fe0, 0x0010}; }

// The bytes of a file as GDCM knows them.
class DicomBytes {
 public:
  explicit DicomBytes(const DicomRequest& request) {
    auto file = std::make_unique<std::ifstream>(request.path.data(), std::ios::binary);
    if (request.is_high_throughput != 1) {
      stream_ = std::move(file);
      return;
    }
    std::string bytes{std::istreambuf_iterator<char>(*file), std::istreambuf_iterator<char>()};
    // Both UIDs take 24 bytes, so that no length changes.
    constexpr char kHighThroughput[] = "1.2.840.10008.1.2.4.20";
    constexpr absl::string_view kJpeg2000("1.2.840.10008.1.2.4.90\0\0", 24);
    const std::size_t at = bytes.find(kHighThroughput);
    if (at != std::string::npos && bytes.size() - at >= kJpeg2000.size()) {
      std::copy(kJpeg2000.begin(), kJpeg2000.end(),
                bytes.begin() + static_cast<std::ptrdiff_t>(at));
    }
    stream_ = std::make_unique<std::istringstream>(std::move(bytes));
  }

  void GiveTo(gdcm::Reader* reader) {
    stream_->clear();
    stream_->seekg(0);
    reader->SetStream(*stream_);
  }
  // Returns true if the last reader went beyond the end.
  [[nodiscard]] bool has_failed() const { return stream_->fail(); }

 private:
  std::unique_ptr<std::istream> stream_;
};

std::string TransferSyntaxOf(const gdcm::Reader& reader) {
  return reader.GetFile().GetHeader().GetDataSetTransferSyntax().GetString();
}

void SetFormat(const gdcm::PixelFormat& format, DicomAnswer* answer) {
  answer->components = format.GetSamplesPerPixel();
  answer->bits_allocated = format.GetBitsAllocated();
  answer->bits_stored = format.GetBitsStored();
  answer->high_bit = format.GetHighBit();
  answer->is_signed = format.GetPixelRepresentation();
}

// ---- High-Throughput JPEG 2000. -----------------------------------------------------------------

// The codestream of a frame; "" if it is not there. It may be cut into several fragments, of which
// the first begins as codestreams do.
std::string CodestreamOf(const gdcm::DataSet& data, std::uint64_t frame) {
  const gdcm::SequenceOfFragments* const fragments =
      data.FindDataElement(PixelsTag()) ? data.GetDataElement(PixelsTag()).GetSequenceOfFragments()
                                        : nullptr;
  std::string codestream;
  std::uint64_t begun = 0;
  const std::size_t count = fragments == nullptr ? 0 : fragments->GetNumberOfFragments();
  for (std::size_t i = 0; i < count; ++i) {
    const gdcm::ByteValue* const bytes = fragments->GetFragment(i).GetByteValue();
    const absl::string_view fragment =
        bytes == nullptr ? "" : absl::string_view(bytes->GetPointer(), bytes->GetLength());
    begun += absl::StartsWith(fragment, "\xff\x4f\xff\x51") ? 1U : 0U;
    if (begun == frame + 1) {
      codestream += std::string(fragment);
    }
  }
  return codestream;
}

// Sets the format of samples as they are decoded, into 8 or 16 bits.
bool DecodeHighThroughput(const gdcm::DataSet& data, std::uint64_t frame, SlicePart part,
                          DicomAnswer* answer, std::string* samples) {
  absl::StatusOr<SliceImage> image = DecodeJpeg2000(CodestreamOf(data, frame), "", part);
  if (!image.ok() || image->width != static_cast<std::int64_t>(answer->dims[0]) ||
      image->height != static_cast<std::int64_t>(answer->dims[1])) {
    return false;
  }
  answer->bits_allocated = static_cast<std::uint32_t>(8 * volume::SizeOf(image->type));
  answer->bits_stored = static_cast<std::uint32_t>(image->bits);
  answer->high_bit = answer->bits_stored - 1;
  answer->is_signed =
      image->type == volume::ScalarType::kInt8 || image->type == volume::ScalarType::kInt16 ? 1 : 0;
  *samples = std::move(image->samples);
  return true;
}

// The data set of a file of High-Throughput JPEG 2000, which is kept for the next frame: all of it
// is read. Null if it can't be read.
const gdcm::DataSet* KeptDataSet(const DicomRequest& request) {
  struct Kept {
    std::string path;
    std::uintmax_t size = 0;
    std::filesystem::file_time_type time;
    std::unique_ptr<DicomBytes> bytes;
    std::unique_ptr<gdcm::Reader> reader;
  };
  static Kept kept;
  std::error_code error;
  const std::string path = request.path.data();
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  const auto time = std::filesystem::last_write_time(path, error);
  if (error || kept.reader == nullptr || kept.path != path || kept.size != size ||
      kept.time != time) {
    kept = Kept();
    kept.path = path;
    kept.size = size;
    kept.time = time;
    kept.bytes = std::make_unique<DicomBytes>(request);
    auto reader = std::make_unique<gdcm::Reader>();
    kept.bytes->GiveTo(reader.get());
    if (!reader->Read()) {
      return nullptr;
    }
    kept.reader = std::move(reader);
  }
  return &kept.reader->GetFile().GetDataSet();
}

// ---- Frames. ------------------------------------------------------------------------------------

// The number of frames (0028,0008); 0 if there are too many or it is none.
std::size_t FrameCount(const gdcm::DataSet& data) {
  const std::string text = DicomBytesOf(data, {0x0028, 0x0008});
  const std::string word(absl::StripAsciiWhitespace(text.substr(0, text.find('\0'))));
  double count = 1;
  if (!word.empty() && !absl::SimpleAtod(word, &count)) {
    return 0;
  }
  return count >= 1 && count <= kMaxDicomFrames ? static_cast<std::size_t>(count) : 0;
}

// Asks the codestream of a compressed image for the type of its pixels.
bool AskCodestream(const DicomRequest& request, DicomBytes* bytes, DicomAnswer* answer) {
  if (request.is_high_throughput == 1) {
    gdcm::Reader reader;
    bytes->GiveTo(&reader);
    std::string none;
    return answer->components > 1 ||
           (reader.Read() && DecodeHighThroughput(reader.GetFile().GetDataSet(), 0,
                                                  SlicePart::kHeader, answer, &none));
  }
  gdcm::ImageReader reader;
  bytes->GiveTo(&reader);
  if (!reader.Read()) {
    return false;
  }
  SetFormat(reader.GetImage().GetPixelFormat(), answer);
  return true;
}

// Fills the shared memory with the frames. False if the file can't be read.
bool ListFrames(const DicomRequest& request, DicomAnswer* answer, char* shared) {
  DicomBytes bytes(request);
  gdcm::Reader reader;
  bytes.GiveTo(&reader);
  if (!reader.ReadUpToTag(PixelsTag())) {
    return false;
  }
  const gdcm::DataSet& data = reader.GetFile().GetDataSet();
  const std::size_t count = FrameCount(data);
  if (count == 0) {
    return false;
  }
  ListDicomFrames(data, count, answer, shared);
  const bool is_encapsulated =
      reader.GetFile().GetHeader().GetDataSetTransferSyntax().IsEncapsulated();
  const bool is_segmentation = answer->segment_kind != DicomSegmentKind::kUnknown;
  if (is_encapsulated && !is_segmentation && (count == 1 || request.is_high_throughput == 1) &&
      !AskCodestream(request, &bytes, answer)) {
    return false;
  }
  answer->outcome = DicomOutcome::kHeader;
  return true;
}

// Copies a frame of an image that is decoded whole. GDCM takes images with fewer pixels than they
// should have, unless those are compressed.
bool CopyFrame(const DicomRequest& request, const gdcm::Image& image, DicomAnswer* answer,
               char* shared) {
  SetFormat(image.GetPixelFormat(), answer);
  answer->dims = {image.GetDimension(0), image.GetDimension(1),
                  image.GetNumberOfDimensions() == 3 ? image.GetDimension(2) : 1};
  const std::uint64_t length = image.GetBufferLength();
  const gdcm::ByteValue* const pixels = image.GetDataElement().GetByteValue();
  if (length != request.frame_bytes * answer->dims[2] || request.frame >= answer->dims[2] ||
      (pixels != nullptr && pixels->GetLength() < length)) {
    return false;
  }
  if (answer->dims[2] == 1) {
    return image.GetBuffer(shared);
  }
  std::vector<char> all(static_cast<std::size_t>(length));
  if (!image.GetBuffer(all.data())) {
    return false;
  }
  std::copy_n(all.data() + request.frame * request.frame_bytes, request.frame_bytes, shared);
  return true;
}

bool DecodeRegion(const DicomRequest& request, DicomBytes* bytes, DicomAnswer* answer,
                  char* shared) {
  gdcm::ImageRegionReader reader;
  bytes->GiveTo(&reader);
  if (!reader.ReadInformation()) {
    return false;
  }
  const gdcm::Image& image = reader.GetImage();
  SetFormat(image.GetPixelFormat(), answer);
  answer->dims = {image.GetDimension(0), image.GetDimension(1),
                  image.GetNumberOfDimensions() == 3 ? image.GetDimension(2) : 1};
  const auto frame = static_cast<unsigned>(request.frame);
  gdcm::BoxRegion region;
  region.SetDomain(0, image.GetDimension(0) - 1, 0, image.GetDimension(1) - 1, frame, frame);
  reader.SetRegion(region);
  return reader.ComputeBufferLength() == request.frame_bytes &&
         reader.ReadIntoBuffer(shared, static_cast<std::size_t>(request.frame_bytes)) &&
         !bytes->has_failed();
}

bool DecodeHighThroughputFrame(const DicomRequest& request, DicomAnswer* answer, char* shared) {
  const gdcm::DataSet* const data = KeptDataSet(request);
  if (data == nullptr) {
    return false;
  }
  const auto side = [data](std::uint16_t element) {
    return static_cast<std::uint64_t>(DicomShortOf(*data, gdcm::Tag(0x0028, element)).value);
  };
  answer->dims = {side(0x0011), side(0x0010), FrameCount(*data)};
  answer->components = 1;
  std::string samples;
  if (!DecodeHighThroughput(*data, request.frame, SlicePart::kAll, answer, &samples) ||
      samples.size() != request.frame_bytes) {
    return false;
  }
  samples.copy(shared, samples.size());
  return true;
}

bool DecodeFrame(const DicomRequest& request, DicomAnswer* answer, char* shared) {
  // Those of the frame before would stay where GDCM does not write.
  std::memset(shared, 0, static_cast<std::size_t>(request.frame_bytes));
  bool is_decoded = false;
  if (request.is_high_throughput == 1) {
    is_decoded = DecodeHighThroughputFrame(request, answer, shared);
  } else {
    DicomBytes bytes(request);
    gdcm::Reader header;
    bytes.GiveTo(&header);
    if (!header.ReadUpToTag(PixelsTag())) {
      return false;
    }
    if (FrameCount(header.GetFile().GetDataSet()) > 1 &&
        TransferSyntaxOf(header) != "1.2.840.10008.1.2.1.99") {
      is_decoded = DecodeRegion(request, &bytes, answer, shared);
    } else {  // one image, or a deflated file, in which GDCM can't seek
      gdcm::ImageReader reader;
      bytes.GiveTo(&reader);
      is_decoded = reader.Read() && CopyFrame(request, reader.GetImage(), answer, shared);
    }
  }
  answer->outcome = is_decoded ? DicomOutcome::kPixels : DicomOutcome::kNotDecoded;
  return is_decoded;
}

// ---- Segments. ----------------------------------------------------------------------------------

// Text in UTF-8, from the set of letters that the file names (0008,0005), if it is Latin 1.
std::string Utf8Of(const std::string& text, absl::string_view letters) {
  if (!absl::StrContains(letters, "ISO_IR 100") && !absl::StrContains(letters, "ISO 2022 IR 100")) {
    return text;
  }
  std::string utf8;
  for (const char letter : text) {
    const auto code = static_cast<unsigned char>(letter);
    if (code < 0x80) {
      utf8 += letter;
    } else {
      utf8 += static_cast<char>(0xc0 | (code >> 6));
      utf8 += static_cast<char>(0x80 | (code & 0x3f));
    }
  }
  return utf8;
}

DicomSegmentRecord SegmentOf(const gdcm::DataSet& item, absl::string_view letters) {
  DicomSegmentRecord segment{};
  segment.number = static_cast<std::uint64_t>(DicomShortOf(item, {0x0062, 0x0004}).value);
  const std::string bytes = Utf8Of(DicomBytesOf(item, {0x0062, 0x0005}), letters);
  const std::string label(absl::StripAsciiWhitespace(bytes.substr(0, bytes.find('\0'))));
  std::copy_n(label.data(), std::min(label.size(), segment.label.size()), segment.label.data());
  const std::string lab = DicomBytesOf(item, {0x0062, 0x000d});
  if (lab.size() == 3 * sizeof(std::uint16_t)) {
    constexpr double kFull = 65535;
    const auto share = [&lab](std::size_t i) {
      return base::LoadLittleEndian<std::uint16_t>(lab.data() + 2 * i) / kFull;
    };
    segment.lab = {100 * share(0), 255 * share(1) - 128, 255 * share(2) - 128};
    segment.has_lab = 1;
  }
  return segment;
}

// Fills the shared memory with the segments. False if the file can't be read.
bool ListSegments(const DicomRequest& request, DicomAnswer* answer, char* shared) {
  DicomBytes file(request);
  gdcm::Reader reader;
  file.GiveTo(&reader);
  if (!reader.ReadUpToTag({0x5200, 0x9229})) {
    return false;
  }
  const gdcm::DataSet& data = reader.GetFile().GetDataSet();
  const std::string letters = DicomBytesOf(data, {0x0008, 0x0005});
  ListDicomFrames(data, 0, answer, shared);  // for the kind
  const gdcm::SmartPointer<gdcm::SequenceOfItems> items = DicomItemsOf(data, {0x0062, 0x0002});
  const std::size_t count =
      items == nullptr ? 0 : std::min<std::size_t>(items->GetNumberOfItems(), kMaxDicomSegments);
  for (std::size_t i = 0; i < count; ++i) {
    const DicomSegmentRecord segment = SegmentOf(items->GetItem(i + 1).GetNestedDataSet(), letters);
    std::memcpy(shared + i * sizeof(segment), &segment, sizeof(segment));
  }
  answer->dims = {count, 0, 0};
  answer->outcome = DicomOutcome::kHeader;
  return true;
}

bool Answer(const DicomRequest& request, DicomAnswer* answer, char* shared) {
  switch (request.question) {
    case DicomQuestion::kFrames:
      return ListFrames(request, answer, shared);
    case DicomQuestion::kFrame:
      return DecodeFrame(request, answer, shared);
    case DicomQuestion::kSegments:
      return ListSegments(request, answer, shared);
  }
  return false;
}

}  // namespace

void DecodeDicomInChild(const void* request_bytes, void* answer_bytes, char* shared) {
  DicomRequest request;
  std::memcpy(&request, request_bytes, sizeof(request));
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  DicomAnswer answer;
  bool is_answered = false;
  try {
    is_answered = Answer(request, &answer, shared);
  } catch (...) {
    is_answered = false;
  }
  answer = is_answered ? answer : DicomAnswer{};
  std::memcpy(answer_bytes, &answer, sizeof(answer));
}

}  // namespace isoscope::source
