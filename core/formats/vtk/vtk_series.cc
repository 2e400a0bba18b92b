// A collection is a small XML file that names one file for each step:
//
//   <VTKFile type="Collection" version="0.1">
//    <Collection>
//     <DataSet timestep="0"    part="0" file="run_0000.vti"/>
//     <DataSet timestep="0.05" part="0" file="run_0001.pvti"/>
//    </Collection>
//   </VTKFile>
//
// Source: https://www.paraview.org/Wiki/ParaView/Data_formats, "PVD File Format".

#include "core/formats/vtk/vtk_series.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/formats/vtk/vtk_image.h"
#include "core/formats/vtk/vtr_image.h"
#include "core/source/bytes/xml_tags.h"
#include "core/source/grid/one_grid.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxPvdSteps = 100'000;

SeriesInfo InfoOf(const std::string& name, const VtkImage& first, std::vector<double> times) {
  SeriesInfo info{.name = name,
                  .times = std::move(times),
                  .time_unit = first.time_unit(),
                  .length_unit = first.length_unit()};
  for (const VtiArray& array : first.arrays()) {
    info.fields.push_back(FieldOfVtiArray(array));
  }
  if (first.component().has_value()) {
    info.fields.front().components = {""};
  }
  return info;
}

class ImageSeries final : public VolumeSeries {
 public:
  ImageSeries(std::unique_ptr<VtkImage> image, std::vector<double> times)
      : VolumeSeries(InfoOf(image->path(), *image, std::move(times))), image_(std::move(image)) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_CHECK(step == 0);
    return image_->Open(static_cast<std::size_t>(field), image_->component().value_or(component));
  }

 private:
  const std::unique_ptr<VtkImage> image_;
};

class PvdSeries final : public VolumeSeries {
 public:
  PvdSeries(SeriesInfo info, GridRules rules, std::vector<PvdStep> steps, const VtkImage& first)
      : VolumeSeries(std::move(info)),
        rules_(std::move(rules)),
        steps_(std::move(steps)),
        arrays_(first.arrays()),
        geometry_(first.geometry()) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    // The first step is read again, as its file may have been replaced since.
    if (image_ == nullptr || open_step_ != step) {
      const std::string& file = steps_[static_cast<std::size_t>(step)].file;
      image_ = nullptr;
      ISOSCOPE_ASSIGN_OR_RETURN(image_, OpenVtkImage(file, "", rules_));
      open_step_ = step;
    }
    const auto wanted = static_cast<std::size_t>(field);
    ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t array, FindArray(arrays_[wanted], step));
    return image_->Open(array, component);
  }
  // Leaves the collection out. It only tells the time and the file, and grows while a simulation
  // runs.
  absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfStep(int step) override {
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<std::string> files,
                              FilesOfPvdStep(steps_[static_cast<std::size_t>(step)]));
    return files;
  }

 private:
  // Finds the array in the open image, which must be like that of the first step.
  absl::StatusOr<std::size_t> FindArray(const VtiArray& like, int step) const {
    const std::string place =
        absl::StrFormat("%s: field \"%s\" at step %d (time %g)", image_->path(), like.name, step,
                        steps_[static_cast<std::size_t>(step)].time);
    const std::vector<VtiArray>& arrays = image_->arrays();
    const auto found = std::find_if(arrays.begin(), arrays.end(), [&](const VtiArray& array) {
      return array.name == like.name && array.is_of_cells == like.is_of_cells;
    });
    if (found == arrays.end()) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: there is no %s array of that name; the first step, %s, has one",
                          place, like.is_of_cells ? "cell" : "point", steps_.front().file));
    }
    if (found->type != like.type || found->components != like.components) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %s of %d components; the first step, %s, has %s of %d", place, found->type,
          found->components, steps_.front().file, like.type, like.components));
    }
    ISOSCOPE_RETURN_IF_ERROR(
        CheckOneGrid(place, image_->geometry(), steps_.front().file, geometry_));
    return static_cast<std::size_t>(found - arrays.begin());
  }

  const GridRules rules_;
  const std::vector<PvdStep> steps_;
  const std::vector<VtiArray> arrays_;  // of the first step
  const volume::GridGeometry geometry_;
  std::unique_ptr<VtkImage> image_;  // of open_step_; null at first
  int open_step_ = 0;
};

absl::StatusOr<PvdStep> StepOf(const XmlTag& tag, const std::string& path) {
  PvdStep step;
  const std::string time = tag.Get("timestep");
  if (!absl::SimpleAtod(time, &step.time) || !std::isfinite(step.time)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("timestep=\"%s\"; expected a finite number", time));
  }
  const std::string file = tag.Get("file");
  if (!absl::EndsWithIgnoreCase(file, ".vti") && !absl::EndsWithIgnoreCase(file, ".pvti") &&
      !absl::EndsWithIgnoreCase(file, ".vtr")) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "file=\"%s\"; expected ImageData (.vti or .pvti) or a RectilinearGrid (.vtr)", file));
  }
  const std::size_t slash = path.rfind('/');
  const bool is_beside = slash != std::string::npos && !absl::StartsWith(file, "/");
  step.file = is_beside ? absl::StrCat(path.substr(0, slash + 1), file) : file;
  return step;
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVtkImageSeries(const std::string& file,
                                                                 const std::string& part,
                                                                 const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VtkImage> image, OpenVtkImage(file, part, rules));
  std::vector<double> times;
  if (part.empty() && image->time().has_value()) {
    times = {*image->time()};
  }
  return std::make_unique<ImageSeries>(std::move(image), std::move(times));
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVtrSeries(const std::string& file,
                                                            const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VtkImage> image, OpenVtrImage(file, "", rules));
  std::vector<double> times;
  if (image->time().has_value()) {
    times = {*image->time()};
  }
  return std::make_unique<ImageSeries>(std::move(image), std::move(times));
}

absl::StatusOr<std::vector<PvdStep>> ReadPvdSteps(const std::string& path) {
  std::vector<PvdStep> steps;
  bool is_collection = false;
  ISOSCOPE_RETURN_IF_ERROR(
      ReadXmlTags(path, "ParaView collection", [&](const XmlTag& tag) -> absl::Status {
        if (tag.name == "Collection") {
          is_collection = true;
        }
        if (tag.name != "DataSet" || tag.parent != "Collection") {
          return absl::OkStatus();
        }
        ISOSCOPE_ASSIGN_OR_RETURN(PvdStep step, StepOf(tag, path));
        if (!steps.empty() && !(step.time > steps.back().time)) {
          return absl::InvalidArgumentError(absl::StrFormat(
              "timestep %g (%s) behind timestep %g (%s); expected times that ascend, each once",
              step.time, step.file, steps.back().time, steps.back().file));
        }
        if (steps.size() == kMaxPvdSteps) {
          return absl::InvalidArgumentError(absl::StrCat("more than ", kMaxPvdSteps, " steps"));
        }
        steps.push_back(std::move(step));
        return absl::OkStatus();
      }));
  if (!is_collection || steps.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": ", is_collection ? "a collection without a DataSet" : "no ParaView collection"));
  }
  return steps;
}

absl::StatusOr<std::vector<std::string>> FilesOfPvdStep(const PvdStep& step) {
  if (absl::EndsWithIgnoreCase(step.file, ".pvti")) {
    return FilesOfPvti(step.file);
  }
  return std::vector<std::string>{step.file};
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenPvdSeries(const std::string& path,
                                                            const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<PvdStep> steps, ReadPvdSteps(path));
  return OpenVtkSteps(path, std::move(steps), rules);
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVtkSteps(const std::string& name,
                                                           std::vector<PvdStep> steps,
                                                           const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VtkImage> first,
                            OpenVtkImage(steps.front().file, "", rules));
  std::vector<double> times;
  times.reserve(steps.size());
  for (const PvdStep& step : steps) {
    times.push_back(step.time);
  }
  return std::make_unique<PvdSeries>(InfoOf(name, *first, std::move(times)), rules,
                                     std::move(steps), *first);
}

}  // namespace isoscope::source
