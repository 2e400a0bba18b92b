#include "core/source/bytes/located_series.h"

#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/source/bytes/file_source.h"

namespace isoscope::source {
namespace {

class LocatedSeries final : public VolumeSeries {
 public:
  LocatedSeries(std::string path, LocatedFile file)
      : path_(std::move(path)), file_(std::move(file)) {
    for (const LocatedField& located : file_.fields) {
      fields_.push_back(located.field);
    }
  }

  [[nodiscard]] const std::string& name() const override { return path_; }
  [[nodiscard]] const std::vector<SourceField>& fields() const override { return fields_; }
  [[nodiscard]] const std::vector<double>& times() const override { return file_.times; }
  [[nodiscard]] const std::string& time_unit() const override { return file_.time_unit; }
  [[nodiscard]] const std::string& length_unit() const override { return file_.length_unit; }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> source,
                              OpenStored(field, component, step));
    return ResampleSource(std::move(source), file_.distances, file_.fill);
  }

 private:
  absl::StatusOr<std::unique_ptr<VolumeSource>> OpenStored(int field, int component, int step) {
    const LocatedField& located = file_.fields[static_cast<std::size_t>(field)];
    const SourceField& named = located.field;
    const std::string name =
        absl::StrCat(path_, fields_.size() > 1 ? absl::StrCat(":", named.name) : "",
                     named.components.size() > 1
                         ? absl::StrCat(":", named.components[static_cast<std::size_t>(component)])
                         : "");
    if (const auto* text = std::get_if<TextLocation>(&located.location)) {
      ISOSCOPE_CHECK(step == 0);
      TextLocation location = *text;
      location.component = component;
      return MakeTextSource(file_.geometry, location, name);
    }
    SampleLocation location = std::get<SampleLocation>(located.location);
    location.component = component;
    location.volume = step;
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> source,
                              MakeFileSource(file_.geometry, location, name));
    if (located.wide.has_value()) {
      return MakeWideSource(std::move(source), *located.wide);
    }
    return source;
  }

  const std::string path_;
  const LocatedFile file_;
  std::vector<SourceField> fields_;
};

}  // namespace

std::unique_ptr<VolumeSeries> MakeLocatedSeries(const std::string& path, LocatedFile file) {
  ISOSCOPE_CHECK(!file.fields.empty());
  return std::make_unique<LocatedSeries>(path, std::move(file));
}

}  // namespace isoscope::source
