// TIFF stacks written by libtiff.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_STACKS_TIFF_FILES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_STACKS_TIFF_FILES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "tiffio.h"

namespace isoscope::testing {

struct TiffStackFile {
  std::uint32_t width = 4;
  std::uint32_t height = 3;
  int pages = 6;
  std::string description{};
  std::string lsm{};                  // the tag CZ_LSMINFO of the first page
  std::vector<double> model_scale{};  // GeoTIFF's tag of the first page
  std::uint32_t depth = 1;            // ImageDepth
  std::uint16_t channels = 1;         // of a page, one after the other
  double resolution = 0;              // pixels in a unit; 0: none
  double y_resolution = 0;            // 0: as that along x
  std::uint16_t unit = RESUNIT_NONE;
  std::uint16_t orientation = ORIENTATION_TOPLEFT;
  std::uint16_t photometric = PHOTOMETRIC_MINISBLACK;
  bool has_thumbnails = false;  // a reduced page of 1 x 1 behind each page
  const char* mode = "wl";
  int first = 0;  // sample i of plane p is 100 * (first + p) + i
};

// The samples of a plane, in the byte order of this machine.
inline std::vector<std::uint16_t> TiffPlane(const TiffStackFile& file, int plane) {
  std::vector<std::uint16_t> samples;
  for (std::uint32_t i = 0; i < file.width * file.height; ++i) {
    samples.push_back(static_cast<std::uint16_t>(100 * (file.first + plane) + static_cast<int>(i)));
  }
  return samples;
}

// False if libtiff can't write it.
inline bool WriteTiffStack(const std::string& path, const TiffStackFile& file) {
  constexpr std::uint32_t kLsmTag = 34412;
  static const TIFFFieldInfo kLsmField[] = {{kLsmTag, TIFF_VARIABLE2, TIFF_VARIABLE2, TIFF_BYTE,
                                             FIELD_CUSTOM, 1, 1, const_cast<char*>("CZ_LSMINFO")}};
  constexpr std::uint32_t kModelScaleTag = 33550;
  static const TIFFFieldInfo kModelScaleField[] = {{kModelScaleTag, TIFF_VARIABLE2, TIFF_VARIABLE2,
                                                    TIFF_DOUBLE, FIELD_CUSTOM, 1, 1,
                                                    const_cast<char*>("ModelPixelScale")}};
  TIFF* const tiff = TIFFOpen(path.c_str(), file.mode);
  if (tiff == nullptr) {
    return false;
  }
  bool is_written = true;
  for (int page = 0; page < file.pages; ++page) {
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, file.width);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, file.height);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 16);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, static_cast<int>(file.channels));
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, static_cast<int>(file.photometric));
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG,
                 file.channels > 1 ? PLANARCONFIG_SEPARATE : PLANARCONFIG_CONTIG);
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, file.height);
    TIFFSetField(tiff, TIFFTAG_ORIENTATION, static_cast<int>(file.orientation));
    if (file.photometric == PHOTOMETRIC_PALETTE) {
      std::vector<std::uint16_t> colours(65536);
      TIFFSetField(tiff, TIFFTAG_COLORMAP, colours.data(), colours.data(), colours.data());
    }
    if (page == 0 && !file.description.empty()) {
      TIFFSetField(tiff, TIFFTAG_IMAGEDESCRIPTION, file.description.c_str());
    }
    if (page == 0 && !file.lsm.empty()) {
      TIFFMergeFieldInfo(tiff, kLsmField, 1);
      TIFFSetField(tiff, kLsmTag, static_cast<std::uint32_t>(file.lsm.size()), file.lsm.data());
    }
    if (page == 0 && !file.model_scale.empty()) {
      TIFFMergeFieldInfo(tiff, kModelScaleField, 1);
      TIFFSetField(tiff, kModelScaleTag, static_cast<std::uint32_t>(file.model_scale.size()),
                   file.model_scale.data());
    }
    if (file.depth > 1) {
      TIFFSetField(tiff, TIFFTAG_IMAGEDEPTH, file.depth);
    }
    if (file.resolution > 0) {
      TIFFSetField(tiff, TIFFTAG_XRESOLUTION, file.resolution);
      TIFFSetField(tiff, TIFFTAG_YRESOLUTION,
                   file.y_resolution > 0 ? file.y_resolution : file.resolution);
      TIFFSetField(tiff, TIFFTAG_RESOLUTIONUNIT, static_cast<int>(file.unit));
    }
    for (std::uint16_t channel = 0; channel < file.channels; ++channel) {
      std::vector<std::uint16_t> samples = TiffPlane(file, page * file.channels + channel);
      const auto bytes = static_cast<tmsize_t>(samples.size() * sizeof(std::uint16_t));
      is_written =
          is_written && TIFFWriteEncodedStrip(tiff, channel, samples.data(), bytes) == bytes;
    }
    is_written = is_written && TIFFWriteDirectory(tiff) != 0;
    if (file.has_thumbnails) {
      TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, FILETYPE_REDUCEDIMAGE);
      TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 1);
      TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 1);
      TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 8);
      TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
      char sample = 'a';
      is_written = is_written && TIFFWriteEncodedStrip(tiff, 0, &sample, 1) == 1 &&
                   TIFFWriteDirectory(tiff) != 0;
    }
  }
  TIFFClose(tiff);
  return is_written;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_STACKS_TIFF_FILES_H_
