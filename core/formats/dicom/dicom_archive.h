// ZIP archives of DICOM files, as picture archives (PACS) export them.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_ARCHIVE_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_ARCHIVE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/series_entry.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// Opens an archive as OpenDicomSteps opens a folder. All its DICOM files are unpacked into a
// temporary folder, which is removed with the series and its volumes; other members are not kept.
// Names of members become no paths. Messages name the archive.
//
// INVALID_ARGUMENT: as ReadZipMembers; no DICOM file; a member whose name leads out of the archive
// (".." or an absolute path), or that is encrypted; members that overlap; a member of more than
// 4 GiB, more than 64 GiB in all, or 200 times the archive and a GiB more: a bomb. DATA_LOSS: a
// member is damaged. RESOURCE_EXHAUSTED: no room in the temporary folder. CANCELLED: interrupted.
// Otherwise as OpenDicomSteps.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenDicomArchive(const std::string& path,
                                                               const std::string& field,
                                                               const GridRules& rules = {});

// The series in the archive, as ListDicomSeries.
absl::StatusOr<std::vector<SeriesEntry>> ListDicomArchive(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_ARCHIVE_H_
