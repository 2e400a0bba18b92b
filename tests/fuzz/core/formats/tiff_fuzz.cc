// TIFF, read by libtiff: what is checked is our way of asking it, and that its errors stay errors.

#include <tiffio.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/fuzz/core/formats/open_volume.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/unit/core/formats/stacks/lsm_bytes.h"
#include "tests/unit/core/formats/stacks/tiff_files.h"

namespace isoscope::fuzz {
namespace {

constexpr std::uint32_t kWidth = 16;
constexpr std::uint32_t kHeight = 4;

void AddPage(TIFF* tiff, int bits, int format, int compression, bool is_tiled) {
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, kWidth);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, kHeight);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, compression);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, format);
  std::string samples(16 * 16 * 8, 'a');
  if (is_tiled) {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, 16);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, 16);
    TIFFWriteTile(tiff, samples.data(), 0, 0, 0, 0);
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 3);
    for (std::uint32_t y = 0; y < kHeight; ++y) {
      TIFFWriteScanline(tiff, samples.data(), y, 0);
    }
  }
  TIFFWriteDirectory(tiff);
}

// Stacks whose heads say what their planes are.
std::vector<testing::TiffStackFile> DescribedStacks() {
  const std::string sizes =
      "<OME><Image><Pixels SizeX=\"4\" SizeY=\"3\" SizeZ=\"2\" SizeC=\"3\" SizeT=\"2\" "
      "DimensionOrder=\"XYCZT\" PhysicalSizeX=\"0.5\" TimeIncrement=\"4\">";
  const std::string end = "</Pixels></Image></OME>";
  const std::string image_j = "ImageJ=1.53\nimages=12\nchannels=3\nslices=2\nframes=2\n";
  return {
      {.pages = 12, .description = sizes + "<Channel Name=\"red\"/>" + end},
      {.pages = 12,
       .description = sizes +
                      "<TiffData IFD=\"0\" PlaneCount=\"12\"><UUID FileName=\"v.tif\">u</UUID>"
                      "</TiffData>" +
                      end,
       .mode = "w8"},
      {.description = "<OME><BinaryOnly MetadataFile=\"v.tif\"/></OME>"},
      {.pages = 12, .description = image_j + "spacing=2.5\nunit=micron\nfinterval=3\n"},
      {.pages = 1, .description = image_j, .mode = "wb"},
      {.pages = 2,
       .lsm = testing::LsmBytes({.slices = 2, .channels = 2}),
       .channels = 2,
       .has_thumbnails = true},
  };
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  for (const char* mode : {"wl", "wb", "w8"}) {
    for (const int compression : {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE}) {
      for (const bool is_tiled : {false, true}) {
        TIFF* const tiff = TIFFOpen(InVolumeFolder("seed.tif").c_str(), mode);
        Require(tiff != nullptr, "a seed can be written");
        const bool is_float = compression == COMPRESSION_LZW;
        for (int page = 0; page < 2; ++page) {
          AddPage(tiff, is_float ? 32 : 16, is_float ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT,
                  compression, is_tiled);
        }
        TIFFClose(tiff);
        seeds.push_back(ReadVolumeFile("seed.tif"));
      }
    }
  }
  for (const testing::TiffStackFile& stack : DescribedStacks()) {
    Require(testing::WriteTiffStack(InVolumeFolder("seed.tif"), stack), "a stack can be written");
    seeds.push_back(ReadVolumeFile("seed.tif"));
  }
  std::filesystem::remove(InVolumeFolder("seed.tif"));
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope::fuzz;
  WriteVolumeFile("v.tif", Input(data, size).Rest());
  OpenAndReadVolume(InVolumeFolder("v.tif"));
  return 0;
}
