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
  explicit LocatedSeries(LocatedFile file) : VolumeSeries(file.info), file_(std::move(file)) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> source,
                              OpenStored(field, component, step));
    return ResampleSource(std::move(source), file_.distances, file_.fill);
  }

 private:
  absl::StatusOr<std::unique_ptr<VolumeSource>> OpenStored(int field, int component, int step) {
    const FieldLocation& located = file_.locations[static_cast<std::size_t>(field)];
    const SourceField& named = info().field(field);
    const std::string name =
        absl::StrCat(info().name, info().fields.size() > 1 ? absl::StrCat(":", named.name) : "",
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

  const LocatedFile file_;
};

}  // namespace

std::unique_ptr<VolumeSeries> MakeLocatedSeries(LocatedFile file) {
  ISOSCOPE_CHECK(!file.locations.empty() && file.locations.size() == file.info.fields.size());
  return std::make_unique<LocatedSeries>(std::move(file));
}

}  // namespace isoscope::source
