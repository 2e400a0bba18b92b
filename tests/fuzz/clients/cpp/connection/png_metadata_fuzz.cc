// The record in a picture, and the picture's pixels. Chunks get right checksums, so that what is in
// them is looked at.
//
//   0 a PNG as it is   1 a PNG, sealed   2 the text of a record

#include <zlib.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "clients/cpp/connection/png_metadata.h"
#include "clients/cpp/picture_file/png_chunks.h"
#include "core/base/sha256.h"
#include "core/image/png_codec.h"
#include "tests/fuzz/fuzz_input.h"
#include "wire/frame_convert.h"

namespace isoscope::fuzz {
namespace {

constexpr std::size_t kMaxDecodedPixels = std::size_t{1} << 24;

// The same chunks, each with its checksum.
std::string Sealed(absl::string_view png) {
  std::string sealed(png.substr(0, client::kPngSignature.size()));
  std::size_t at = sealed.size();
  while (png.size() - at >= 12) {
    const std::size_t size = client::LoadBigEndian32(png.substr(at));
    if (size > png.size() - at - 12) {
      break;
    }
    const absl::string_view content = png.substr(at + 4, 4 + size);
    const auto crc = static_cast<std::uint32_t>(crc32(
        0, reinterpret_cast<const Bytef*>(content.data()), static_cast<uInt>(content.size())));
    sealed.append(png.data() + at, 8 + size);
    sealed += client::BigEndian32(crc);
    at += 12 + size;
  }
  sealed.append(png.data() + at, png.size() - at);
  return sealed;
}

void RequireRoundTrip(const client::PictureRecord& record) {
  const auto again = client::DecodePictureRecord(client::EncodePictureRecord(record));
  Require(again.ok(), "a record comes back from its text");
  Require(again->picture_revision == record.picture_revision &&
              again->samples_digest == record.samples_digest &&
              again->annotated == record.annotated,
          "a record comes back whole");
}

void ReadRecord(absl::string_view text) {
  const auto record = client::DecodePictureRecord(text);
  if (!record.ok()) {
    RequireError(record.status(),
                 {absl::StatusCode::kDataLoss, absl::StatusCode::kFailedPrecondition});
    return;
  }
  RequireRoundTrip(*record);
  static_cast<void>(wire::FrameSpecFromProto(record->request));
}

void ReadPng(const std::string& png) {
  const auto split = client::SplitRecordedPng(png);
  if (split.ok()) {
    RequireRoundTrip(split->record);
    Require(split->plain_png.size() < png.size(), "a picture without its record is smaller");
  } else {
    RequireError(split.status(), {absl::StatusCode::kNotFound, absl::StatusCode::kDataLoss,
                                  absl::StatusCode::kFailedPrecondition});
  }
  const auto pixels = image::DecodePng(png);
  if (!pixels.ok()) {
    RequireError(pixels.status(), {absl::StatusCode::kDataLoss});
    return;
  }
  Require(pixels->pixels.size() ==
              static_cast<std::size_t>(pixels->width) * static_cast<std::size_t>(pixels->height),
          "a picture has all of its pixels");
  Require(pixels->pixels.size() < kMaxDecodedPixels, "few bytes make no huge picture");
}

}  // namespace

std::vector<std::string> Seeds() {
  const std::vector<image::Rgba8> pixels(6, image::Rgba8{1, 2, 3, 100});
  const std::string plain = image::EncodePng(3, 2, pixels);
  client::PictureRecord record;
  record.picture_revision = "2 cpu";
  record.samples_digest = "00112233445566778899aabbccddeeff";
  record.request.set_isovalue(0.1);
  record.request.mutable_camera()->mutable_eye()->set_z(3);
  record.request.mutable_camera()->mutable_target();
  record.request.mutable_camera()->mutable_perspective()->set_fov_y_degrees(30);
  record.request.mutable_viewport()->set_width_px(3);
  record.request.mutable_viewport()->set_height_px(2);
  std::vector<std::string> seeds{std::string(1, '\0') + plain, "\1" + plain};
  for (const bool is_annotated : {false, true}) {
    if (is_annotated) {
      record.annotated = client::AnnotatedPicture{.plain_png_sha256 = base::Sha256Hex("x"),
                                                  .boxes = {{1, 1, 2, 2}}};
    }
    const auto png = client::AddPictureRecord(plain, record);
    Require(png.ok(), "a seed can be made");
    seeds.push_back("\1" + *png);
    seeds.push_back("\2" + client::EncodePictureRecord(record));
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Input input(data, size);
  const std::uint8_t mode = input.Byte() % 3;
  const absl::string_view bytes = input.Rest();
  if (mode == 2) {
    isoscope::fuzz::ReadRecord(bytes);
  } else {
    isoscope::fuzz::ReadPng(mode == 0 ? std::string(bytes) : isoscope::fuzz::Sealed(bytes));
  }
  return 0;
}
