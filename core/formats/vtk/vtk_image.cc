#include "core/formats/vtk/vtk_image.h"

#include <algorithm>
#include <iterator>
#include <set>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/formats/vtk/vti_choice.h"
#include "core/formats/vtk/vti_grid.h"
#include "core/formats/vtk/vti_source.h"
#include "core/formats/vtk/vtr_image.h"
#include "core/io/file.h"

namespace isoscope::source {
namespace {

class VtiImage final : public VtkImage {
 public:
  static absl::StatusOr<std::unique_ptr<VtkImage>> Open(const std::string& path,
                                                        const std::string& part,
                                                        const GridRules& rules) {
    auto image = std::make_unique<VtiImage>();
    image->path_ = path;
    {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                                io::OpenRandomAccessFile(path));
      ISOSCOPE_ASSIGN_OR_RETURN(image->header_, ReadWholeVtiHeader(*file));
    }
    ISOSCOPE_RETURN_IF_ERROR(image->SetArrays(image->header_, part));
    ISOSCOPE_ASSIGN_OR_RETURN(
        image->geometry_,
        VtiGeometry(image->header_, image->arrays_.front().is_of_cells, path, rules));
    ISOSCOPE_ASSIGN_OR_RETURN(image->time_, ReadVtiTime(path, image->header_));
    return image;
  }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(std::size_t array,
                                                     std::int64_t component) override {
    return OpenVtiArray(path_, header_, {.array = arrays_[array], .component = component},
                        geometry_, NameOf(array, component));
  }

 private:
  VtiHeader header_;
};

bool IsFieldArray(const VtiArray& array) {
  return IsVtiNumber(array.type) && array.name != "vtkGhostType";
}

absl::Status CheckNames(const std::vector<VtiArray>& arrays, const std::string& path) {
  std::set<std::string> names;
  for (const VtiArray& array : arrays) {
    if (array.name.empty()) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: a %s array without a name: name one of the others, as in %s:name",
                          path, array.is_of_cells ? "cell" : "point", path));
    }
    if (!names.insert(array.name).second) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: two arrays are called \"%s\"", path, array.name));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status VtkImage::SetArrays(const VtiHeader& header, const std::string& part) {
  part_ = part;
  time_unit_ = header.time_value.has_value() ? header.time_value->unit : "";
  constexpr std::size_t kMaxUnitBytes = 64;
  const auto length = header.image.find("Unit");
  length_unit_ = length == header.image.end() ? "" : length->second.substr(0, kMaxUnitBytes);
  for (const bool is_of_cells : {false, true}) {
    std::copy_if(header.arrays.begin(), header.arrays.end(), std::back_inserter(arrays_),
                 [&](const VtiArray& array) {
                   return IsFieldArray(array) && array.is_of_cells == is_of_cells &&
                          (part.empty() || array.name == part);
                 });
    if (!arrays_.empty()) {
      return CheckNames(arrays_, path_);
    }
  }
  // A component is named, or all that there is has a reason to be refused.
  ISOSCOPE_ASSIGN_OR_RETURN(VtiChoice choice, ChooseVtiArray(header, part, path_));
  if (part.empty() || !IsFieldArray(choice.array)) {
    ISOSCOPE_RETURN_IF_ERROR(VtiTypeOf(choice.array, path_).status());
    return absl::InvalidArgumentError(absl::StrCat(path_, ": no array of numbers"));
  }
  component_ = choice.component;
  arrays_ = {std::move(choice.array)};
  return absl::OkStatus();
}

std::string VtkImage::NameOf(std::size_t array, std::int64_t component) const {
  const VtiArray& chosen = arrays_[array];
  if (arrays_.size() == 1 && (chosen.components == 1 || component_.has_value())) {
    return part_.empty() ? path_ : absl::StrCat(path_, ":", part_);
  }
  return absl::StrCat(path_, ":", chosen.name,
                      chosen.components > 1 ? absl::StrCat(":", component) : "");
}

bool SplitVtkImagePath(const std::string& path, PartPath* parts) {
  return SplitPartPath(path, {".vti", ".pvti"}, parts);
}

absl::StatusOr<std::unique_ptr<VtkImage>> OpenVtkImage(const std::string& path,
                                                       const std::string& part,
                                                       const GridRules& rules) {
  if (absl::EndsWithIgnoreCase(path, ".vtr")) {
    return OpenVtrImage(path, part, rules);
  }
  return absl::EndsWithIgnoreCase(path, ".pvti") ? OpenPvtiImage(path, part, rules)
                                                 : VtiImage::Open(path, part, rules);
}

SourceField FieldOfVtiArray(const VtiArray& array) {
  SourceField field{.name = array.name,
                    .long_name = array.is_of_cells
                                     ? absl::StrCat(array.name, " (of cells, at their centres)")
                                     : "",
                    .unit = array.unit};
  const std::set<std::string> distinct(array.component_names.begin(), array.component_names.end());
  if (array.components == 1) {
    return field;
  }
  field.components = array.component_names;
  if (distinct.size() != static_cast<std::size_t>(array.components) ||
      distinct.contains("magnitude")) {
    field.components.clear();
    for (std::int64_t i = 0; i < array.components; ++i) {
      field.components.push_back(array.components == 3 ? std::string(1, "xyz"[i])
                                                       : absl::StrCat(i));
    }
  }
  return field;
}

}  // namespace isoscope::source
