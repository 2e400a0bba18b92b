// Zarr 2 and 3, OME-Zarr: folders and ZIP archives that hold arrays in chunks.

#ifndef ISOSCOPE_CORE_FORMATS_ZARR_ZARR_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_ZARR_ZARR_SERIES_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/formats/zarr/zarr_store.h"
#include "core/source/bytes/byte_source.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"
#include "core/volume/label.h"

namespace isoscope::source {

// The file or folder of a store, and what it names of it: "run.zarr" and "a/b:x".
struct ZarrPath {
  std::string file;
  std::string part{};
};
// Returns true if the folder has the metadata of a group or an array.
bool IsZarrFolder(const std::string& folder);
// A folder of a store, perhaps with ':' and a part behind it; or a file of its metadata. The store
// begins at the uppermost folder of those around it that are groups: "run.zarr/0" is the part "0" of
// "run.zarr". Not set: none of these.
std::optional<ZarrPath> FindZarrPath(const std::string& path);

// Returns true if a ZIP archive has the metadata of a group or an array at its top, or in a folder
// there.
bool IsZarrArchive(const std::string& file);

// Opens a store on the local disk, a folder or a ZIP archive. Errors as ZarrStore::Open.
absl::StatusOr<std::unique_ptr<ZarrStore>> OpenLocalZarr(const std::string& file);
// A ZIP archive whose top, or whose only folder there, is a store. INVALID_ARGUMENT: it is none.
absl::StatusOr<std::unique_ptr<ZarrStore>> OpenZippedZarr(std::shared_ptr<const ByteSource> bytes);

// Opens the volumes that `part` names: a group or an array ("a/b"), a field ("DAPI"), or a component
// of one, behind a colon if both are ("a/b:x"). An array of a group without an image is one field;
// all others are the fields of one grid (zarr_volumes.h). Of a
// folder, FilesOfStep leaves out the chunks of other steps. Errors as FindZarrVolumes and SelectPart.
// Opening a volume: as OpenStoredArray and ResampleSource.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenZarrSeries(std::unique_ptr<ZarrStore> store,
                                                             const std::string& part,
                                                             const std::string& axes,
                                                             const GridRules& rules = {});

// The names and colours of the labels that `part` names, a label image or a level of it; none for
// others. Errors as FindZarrLabels.
absl::StatusOr<std::vector<volume::Label>> ZarrLabelsOf(ZarrStore* store, const std::string& part);

// The files that decide its samples: the archive; or metadata, from the store's root on, and all
// files of the arrays and of the coordinates of their axes. RESOURCE_EXHAUSTED: more than 16 Mi.
// Otherwise errors as OpenZarrSeries; but a field that is not there is none.
absl::StatusOr<std::vector<std::string>> FilesOfZarr(const std::string& file,
                                                     const std::string& part,
                                                     const std::string& axes,
                                                     const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ZARR_ZARR_SERIES_H_
