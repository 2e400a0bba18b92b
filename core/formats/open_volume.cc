#include "core/formats/open_volume.h"

#include <utility>

#include "core/base/status_macros.h"
#include "core/formats/format_table.h"
#include "core/formats/refused_formats.h"
#include "core/source/series_parts.h"

namespace isoscope::source {
namespace {

// All that the row is to know.
FileRequest RequestOf(FoundVolume found, const SeriesOptions& options,
                      absl::Span<const Format> formats) {
  FileRequest request = std::move(found.request);
  request.field = FieldNameOf(request.part.empty() ? request.path : request.file, formats);
  request.rules = options.rules;
  request.axes = options.axes;
  return request;
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenRow(const Format& format,
                                                      const FileRequest& request,
                                                      absl::Span<const Format> formats) {
  ISOSCOPE_RETURN_IF_ERROR(CheckAxes(format, request.path, request.axes, formats));
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> series, format.open(request));
  return request.part.empty() || format.opens_parts
             ? std::move(series)
             : SelectPart(std::move(series), request.file, request.part);
}

absl::StatusOr<std::vector<std::string>> FindFiles(const std::string& path,
                                                   const SeriesOptions& options,
                                                   absl::Span<const Format> formats) {
  ISOSCOPE_ASSIGN_OR_RETURN(FoundVolume found, FindVolume(path, options.format, formats));
  const Format& format = *found.format;
  FileRequest request = RequestOf(std::move(found), options, formats);
  return format.find_files != nullptr ? format.find_files(request) : std::move(request.files);
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenFoundVolume(FoundVolume found,
                                                              const SeriesOptions& options,
                                                              absl::Span<const Format> formats) {
  const Format& format = *found.format;
  const FileRequest request = RequestOf(std::move(found), options, formats);
  auto series = OpenRow(format, request, formats);
  return series.ok() ? std::move(series) : ExplainByContent(request.path, series.status(), formats);
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVolumeSeries(const std::string& path,
                                                               const SeriesOptions& options,
                                                               absl::Span<const Format> formats) {
  auto found = FindVolume(path, options.format, formats);
  return found.ok() ? OpenFoundVolume(*std::move(found), options, formats)
                    : ExplainByContent(path, found.status(), formats);
}

absl::StatusOr<std::vector<std::string>> FilesOfVolume(const std::string& path,
                                                       const SeriesOptions& options,
                                                       absl::Span<const Format> formats) {
  auto files = FindFiles(path, options, formats);
  return files.ok() ? std::move(files) : ExplainByContent(path, files.status(), formats);
}

}  // namespace isoscope::source
