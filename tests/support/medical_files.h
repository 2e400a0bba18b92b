// Headers of medical volume files, made of literal bytes.

#ifndef ISOSCOPE_TESTS_SUPPORT_MEDICAL_FILES_H_
#define ISOSCOPE_TESTS_SUPPORT_MEDICAL_FILES_H_

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/math/vec.h"

namespace isoscope::testing {

// Writes numbers at offsets of a header of zeros.
class HeaderBytes {
 public:
  HeaderBytes(std::size_t size, bool is_big_endian)
      : bytes_(size, '\0'), is_big_endian_(is_big_endian) {}

  template <typename T>
  HeaderBytes& Put(std::size_t offset, T value) {
    std::memcpy(bytes_.data() + offset, &value, sizeof(value));
    if (is_big_endian_) {
      std::reverse(bytes_.begin() + static_cast<std::ptrdiff_t>(offset),
                   bytes_.begin() + static_cast<std::ptrdiff_t>(offset + sizeof(value)));
    }
    return *this;
  }
  HeaderBytes& PutText(std::size_t offset, const std::string& text) {
    bytes_.replace(offset, text.size(), text);
    return *this;
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
  bool is_big_endian_;
};

struct Nifti2Header {
  math::Index3 dims{4, 3, 2};
  std::int64_t steps = 1;
  std::int64_t components = 1;
  std::int16_t datatype = 4;
  double slope = 0;
  double intercept = 0;
  std::int32_t qform_code = 0;
  std::int32_t sform_code = 1;
  double shear = 0;
  std::int32_t units = 10;  // millimetres, seconds
  bool is_pair = false;
  bool is_big_endian = false;
};

// 544 bytes. The sform, RAS: rows (shear, -2, 0, 10), (1.5, 0, 0, 20), (0, 0, 3, 30). The qform is
// the same without the shear.
inline std::string Nifti2Bytes(const Nifti2Header& h) {
  HeaderBytes b(544, h.is_big_endian);
  b.Put(0, std::int32_t{540})
      .PutText(4, std::string(h.is_pair ? "ni2" : "n+2") + '\0' + "\r\n\032\n");
  b.Put(12, h.datatype);
  const std::array<std::int64_t, 8> dims{5,       h.dims.x,     h.dims.y, h.dims.z,
                                         h.steps, h.components, 1,        1};
  const std::array<double, 5> distances{1, 1.5, 2, 3, 0.5};
  for (std::size_t i = 0; i < dims.size(); ++i) {
    b.Put(16 + 8 * i, dims[i]);
  }
  for (std::size_t i = 0; i < distances.size(); ++i) {
    b.Put(104 + 8 * i, distances[i]);
  }
  b.Put(168, std::int64_t{h.is_pair ? 0 : 544}).Put(176, h.slope).Put(184, h.intercept);
  b.Put(344, h.qform_code).Put(348, h.sform_code);
  b.Put(368, std::sqrt(0.5));  // a quarter of a turn about z
  b.Put(376, 10.0).Put(384, 20.0).Put(392, 30.0);
  const std::array<double, 12> rows{h.shear, -2, 0, 10, 1.5, 0, 0, 20, 0, 0, 3, 30};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    b.Put(400 + 8 * i, rows[i]);
  }
  return b.Put(500, h.units).bytes();
}

struct AnalyzeHeader {
  math::Index3 dims{4, 3, 2};
  std::int16_t steps = 1;
  std::int16_t datatype = 4;
  float factor = 0;
  bool is_big_endian = false;
};

// 348 bytes; distances 1.5, 2, 3.
inline std::string AnalyzeBytes(const AnalyzeHeader& h) {
  HeaderBytes b(348, h.is_big_endian);
  b.Put(0, std::int32_t{348}).Put(40, std::int16_t{4});
  b.Put(42, static_cast<std::int16_t>(h.dims.x)).Put(44, static_cast<std::int16_t>(h.dims.y));
  b.Put(46, static_cast<std::int16_t>(h.dims.z)).Put(48, h.steps).Put(70, h.datatype);
  b.Put(80, 1.5F).Put(84, 2.0F).Put(88, 3.0F).Put(92, 0.5F).Put(112, h.factor);
  return b.bytes();
}

struct MghHeader {
  math::Index3 dims{4, 3, 2};
  std::int32_t frames = 1;
  std::int32_t type = 4;
  bool is_placed = true;
};

// 284 bytes; distances 1.5, 2, 3; x to anterior, y to the left, z up; the centre at (10, 20, 30).
inline std::string MghBytes(const MghHeader& h) {
  HeaderBytes b(284, true);
  b.Put(0, std::int32_t{1}).Put(4, static_cast<std::int32_t>(h.dims.x));
  b.Put(8, static_cast<std::int32_t>(h.dims.y)).Put(12, static_cast<std::int32_t>(h.dims.z));
  b.Put(16, h.frames).Put(20, h.type).Put(28, static_cast<std::int16_t>(h.is_placed ? 1 : 0));
  const std::array<float, 15> numbers{1.5F, 2, 3, 0, 1, 0, -1, 0, 0, 0, 0, 1, 10, 20, 30};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    b.Put(30 + 4 * i, numbers[i]);
  }
  return b.bytes();
}

// An attribute of an AFNI header.
inline std::string AfniNumbers(const std::string& name, const std::string& numbers, int count) {
  return absl::StrCat("\ntype  = float-attribute\nname  = ", name, "\ncount = ", count, "\n ",
                      numbers, "\n");
}
inline std::string AfniText(const std::string& name, const std::string& text) {
  return absl::StrCat("\ntype = string-attribute\nname = ", name, "\ncount = ", text.size() + 1,
                      "\n'", text, "~\n");
}

// A header of 4 x 3 x 2 int16; LPS rows (0, -2, 0, 10), (1.5, 0, 0, 20), (0, 0, 3, 30).
inline std::string AfniBytes(int sub_bricks, const std::string& types, const std::string& factors,
                             const std::string& more = "") {
  return absl::StrCat(
      AfniText("TYPESTRING", "3DIM_HEAD_ANAT"),
      AfniNumbers("DATASET_RANK", absl::StrCat("3 ", sub_bricks, " 0 0 0 0 0 0"), 8),
      AfniNumbers("DATASET_DIMENSIONS", "4 3 2 0 0", 5),
      AfniNumbers("BRICK_TYPES", types, sub_bricks),
      AfniNumbers("BRICK_FLOAT_FACS", factors, sub_bricks),
      AfniNumbers("IJK_TO_DICOM_REAL", "0 -2 0 10 1.5 0 0 20 0 0 3 30", 12),
      AfniText("BYTEORDER_STRING", "LSB_FIRST"), more);
}

struct ParLine {
  int slice = 1;
  int echo = 1;
  int dynamic = 1;
  int type = 0;
  int index = 0;
  double slope = 1;
  double intercept = 0;
  double dynamic_time = 0;
  int orientation = 1;
  double gap = 1;
  int sequence = 2;
  double b_factor = 0;
};

// A line of an image of 4 x 3 samples of 16 bits, 1.5 x 2 apart, 2 thick.
inline std::string ParImage(const ParLine& l) {
  return absl::StrFormat(
      "%3d %3d %3d  1 %d %d %4d  16  100  4  3  %g %g 0.004  1070 1860  0 0 0  0 0 0  2.000 %g 0 "
      "%d "
      "0 2  1.5 2  %g  %g  0.00  %g  1  90.0  0 0 0  1  0.0\n",
      l.slice, l.echo, l.dynamic, l.type, l.sequence, l.index, l.intercept, l.slope, l.gap,
      l.orientation, 10.0 * l.echo, l.dynamic_time, l.b_factor);
}

// A PAR file of two slices a volume, with its centre at posterior 10, superior 20, left 30.
inline std::string ParBytes(const std::string& images, const std::string& angles = "0 0 0") {
  return absl::StrCat(
      "# === DATA DESCRIPTION FILE ===\n#\n# CLINICAL TRYOUT   Research image export tool   "
      "V4\n#\n",
      ".    Patient name                       :   nobody\n",
      ".    Max. number of slices/locations    :   2\n",
      ".    Angulation midslice(ap,fh,rl)[degr]:   ", angles, "\n",
      ".    Off Centre midslice(ap,fh,rl) [mm] :   10 20 30\n#\n#  sl ec dyn ...\n\n", images,
      "\n# === END OF DATA DESCRIPTION FILE ===\n");
}

// The parameters of a ParaVision reconstruction of frames of 4 x 3 samples, each 2 x 1.5 mm.
struct BrukerScan {
  struct Group {
    int count = 1;
    std::string name{};
  };
  int slices = 3;
  bool is_volume = false;         // frames of this many slices; else a frame is one
  std::vector<Group> groups{};    // empty: FG_SLICE, or none of a volume
  std::vector<double> slopes{2};  // one, or by frame
  std::vector<double> offsets{0};
  std::string axes = "1 0 0 0 1 0 0 0 1";
  math::Vec3d slice_step{0, 0, 3};  // from (10, 20, 30) on
  std::string type = "_16BIT_SGN_INT";
  std::string byte_order = "littleEndian";
  std::string more{};
};

inline std::string BrukerText(BrukerScan scan) {
  if (scan.groups.empty() && !scan.is_volume) {
    scan.groups = {{scan.slices, "FG_SLICE"}};
  }
  int frames = 1;
  std::string groups;
  for (const BrukerScan::Group& group : scan.groups) {
    frames *= group.count;
    absl::StrAppend(&groups, groups.empty() ? "" : " ", "(", group.count, ", <", group.name,
                    ">, <a (b)>, 0, 2)");
  }
  const int places = scan.is_volume ? 1 : scan.slices;
  std::vector<std::string> axes;
  std::vector<std::string> positions;
  for (int i = 0; i < places; ++i) {
    axes.push_back(scan.axes);
    const math::Vec3d at = math::Vec3d{10, 20, 30} + scan.slice_step * static_cast<double>(i);
    positions.push_back(absl::StrFormat("%g %g %g", at.x, at.y, at.z));
  }
  const auto array = [](std::size_t count, const std::string& values) {
    return absl::StrCat("( ", count, " )\n", values, "\n");
  };
  return absl::StrCat(
      "##TITLE=Parameter List\n##JCAMPDX=4.24\n##DATATYPE=Parameter Values\n##ORIGIN=a\n"
      "##OWNER=b\n$$ a date\n$$ a path\n##$VisuVersion=1\n"
      "##$VisuCoreFrameCount=",
      frames, "\n##$VisuCoreDim=", scan.is_volume ? 3 : 2, "\n##$VisuCoreSize=",
      scan.is_volume ? array(3, absl::StrCat("4 3 ", scan.slices)) : array(2, "4 3"),
      "##$VisuCoreDimDesc=",
      scan.is_volume ? array(3, "spatial spatial spatial") : array(2, "spatial spatial"),
      "##$VisuCoreExtent=",
      scan.is_volume ? array(3, absl::StrCat("8 4.5 ", 3 * scan.slices)) : array(2, "8 4.5"),
      "##$VisuCoreOrientation=( ", places, ", 9 )\n", absl::StrJoin(axes, " "),
      "\n##$VisuCorePosition=( ", places, ", 3 )\n", absl::StrJoin(positions, " "),
      "\n##$VisuCoreDataOffs=", array(scan.offsets.size(), absl::StrJoin(scan.offsets, " ")),
      "##$VisuCoreDataSlope=", array(scan.slopes.size(), absl::StrJoin(scan.slopes, " ")),
      "##$VisuCoreWordType=", scan.type, "\n##$VisuCoreByteOrder=", scan.byte_order, "\n",
      groups.empty() ? "" : absl::StrCat("##$VisuFGOrderDesc=", array(scan.groups.size(), groups)),
      scan.more, "##END=\n");
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_MEDICAL_FILES_H_
