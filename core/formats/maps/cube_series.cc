// A cube file is text:
//
//   two lines of comment
//     2   0.0 0.0 0.0   1      atoms, origin, values a voxel (1 where it is left out)
//    40   0.2 0.0 0.0          voxels along the first, slowest axis, and the step
//    40   0.0 0.2 0.0
//    60   0.0 0.0 0.2          the third, fastest axis
//     8   8.0 0.1 0.0 0.0      a line an atom
//     2   5 6                  only if the number of atoms is negative: orbitals, their numbers
//   0.12345E-05 ...            values of a voxel together, then the next voxel of the third axis
//
// Source: https://gaussian.com/cubegen, https://paulbourke.net/dataformats/cube.

#include "core/formats/maps/cube_series.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/located_series.h"
#include "core/source/bytes/text_scanner.h"
#include "core/source/series_parts.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxCubeOrbitals = 4096;
constexpr std::int64_t kMaxCubeAtoms = 10'000'000;

// An integer and three numbers, perhaps another integer.
struct CubeLine {
  std::int64_t count = 0;
  math::Vec3d vector;
  std::int64_t values = 1;
};

absl::StatusOr<CubeLine> ReadCubeLine(TextScanner* scanner, const char* what, bool may_have_more) {
  ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view text, scanner->NextLine());
  const std::vector<std::string> words =
      absl::StrSplit(text, absl::ByAnyChar(" \t"), absl::SkipEmpty());
  CubeLine line;
  bool is_good = (words.size() == 4 || (may_have_more && words.size() == 5)) &&
                 absl::SimpleAtoi(words[0], &line.count);
  for (int axis = 0; is_good && axis < 3; ++axis) {
    is_good = absl::SimpleAtod(words[1 + static_cast<std::size_t>(axis)], &line.vector[axis]) &&
              std::isfinite(line.vector[axis]);
  }
  if (!is_good || (words.size() == 5 && !absl::SimpleAtoi(words[4], &line.values))) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "no Gaussian cube file: its line of %s is \"%s\"; expected a number and three coordinates",
        what, text.substr(0, 80)));
  }
  return line;
}

absl::StatusOr<std::vector<std::string>> ReadOrbitals(TextScanner* scanner) {
  std::vector<std::string> names;
  std::int64_t count = 1;
  for (std::int64_t i = -1; i < count; ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view word, scanner->NextWord());
    std::int64_t number = 0;
    if (!absl::SimpleAtoi(word, &number) || (i < 0 && (number < 1 || number > kMaxCubeOrbitals))) {
      return absl::InvalidArgumentError(
          absl::StrFormat("\"%s\" in its list of orbitals; expected their number, 1 to %d, and the "
                          "number of each",
                          word.substr(0, 40), kMaxCubeOrbitals));
    }
    if (i < 0) {
      count = number;
    } else {
      names.push_back(absl::StrCat(number));
    }
  }
  return names;
}

absl::StatusOr<LocatedFile> LocateCube(const io::RandomAccessFile& file, const std::string& field) {
  TextScanner scanner(&file);
  ISOSCOPE_RETURN_IF_ERROR(scanner.NextLine().status());
  ISOSCOPE_RETURN_IF_ERROR(scanner.NextLine().status());
  ISOSCOPE_ASSIGN_OR_RETURN(const CubeLine atoms, ReadCubeLine(&scanner, "atoms", true));
  if (atoms.values < 1 || atoms.values > kMaxCubeOrbitals || atoms.count > kMaxCubeAtoms ||
      atoms.count < -kMaxCubeAtoms) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d atoms and %d values a voxel; expected at most %d and 1 to %d",
                        atoms.count, atoms.values, kMaxCubeAtoms, kMaxCubeOrbitals));
  }
  LocatedFile located{.info = {.name = file.path()}};
  located.geometry.origin = atoms.vector;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    ISOSCOPE_ASSIGN_OR_RETURN(const CubeLine line, ReadCubeLine(&scanner, "a grid's axis", false));
    const char* const unit = line.count < 0 ? "angstrom" : "bohr";
    if (axis > 0 && located.info.length_unit != unit) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "axis %d has %d voxels, those before it %s: a negative number means angstroms, a "
          "positive one bohr; expected one sign for all three axes",
          axis, line.count, located.info.length_unit == "bohr" ? "more than 0" : "less than 0"));
    }
    located.info.length_unit = unit;
    const std::size_t index = 2 - axis;  // the last is the fastest
    const double length = math::Length(line.vector);
    constexpr std::int64_t kMaxAxis = std::int64_t{1} << 24;
    if (line.count < -kMaxAxis || line.count > kMaxAxis || line.count == 0 || !(length > 0)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%d voxels, %g apart, along axis %d; expected 2 to %d, apart", line.count,
                          length, axis, kMaxAxis));
    }
    located.geometry.sample_dims[static_cast<int>(index)] = std::abs(line.count);
    located.geometry.spacing[static_cast<int>(index)] = length;
    located.geometry.direction.columns[index] = line.vector * (1 / length);
  }
  for (std::int64_t i = 0; i < std::abs(atoms.count); ++i) {
    if (scanner.is_at_end()) {
      return absl::InvalidArgumentError("the file ends within its atoms: it is cut");
    }
    ISOSCOPE_RETURN_IF_ERROR(scanner.NextLine().status());
  }
  SourceField only{.name = field, .components = ComponentNames(atoms.values)};
  if (atoms.count < 0) {
    ISOSCOPE_ASSIGN_OR_RETURN(only.components, ReadOrbitals(&scanner));
    if (only.components.size() == 1) {
      only.long_name = absl::StrCat(field, ", orbital ", only.components[0]);
      only.components = {""};
    }
  }
  const auto components = static_cast<std::int64_t>(only.components.size());
  located.Add(std::move(only), {.location = TextLocation{.file = file.path(),
                                                         .offset = scanner.position(),
                                                         .type = volume::ScalarType::kFloat32,
                                                         .components = components}});
  return located;
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenCubeSeries(const std::string& file,
                                                             const std::string& field) {
  if (IsGzipFile(file)) {
    return absl::InvalidArgumentError(absl::StrCat(
        file,
        ": a Gaussian cube file in a gzip stream, which is not read: decompress it (gunzip)"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> opened,
                            io::OpenRandomAccessFile(file));
  auto located = LocateCube(*opened, field);
  if (!located.ok()) {
    return absl::Status(located.status().code(),
                        absl::StrCat(file, ": ", located.status().message()));
  }
  return MakeLocatedSeries(*std::move(located));
}

}  // namespace isoscope::source
