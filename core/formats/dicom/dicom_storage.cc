// Source: DICOM PS3.4, B.5 and B.6 (storage classes, retired ones too); PS3.6, A (UIDs).

#include "core/formats/dicom/dicom_storage.h"

#include <array>

#include "absl/algorithm/container.h"
#include "absl/strings/match.h"
#include "absl/strings/strip.h"

namespace isoscope::source {
namespace {

constexpr absl::string_view kStandard = "1.2.840.10008.";
constexpr absl::string_view kStorage = "5.1.4.1.1.";  // behind kStandard
// Film sheets, which are images, outside the others.
constexpr std::array<absl::string_view, 2> kHardcopies{"1.2.840.10008.5.1.1.29",
                                                       "1.2.840.10008.5.1.1.30"};
constexpr absl::string_view kSiemensNoImage = "1.3.12.2.1107.5.9.1";

// Behind kStorage. One that ends with a dot is a family.
constexpr auto kWithoutPixels = std::to_array<absl::string_view>({
    "4.2",                       // spectra
    "9.",                        // curves
    "10",       "11",    "11.",  // tables, presentations
    "66",       "66.1",  "66.2", "66.3",
    "66.5",     "66.6",                  // raw data, registrations, surfaces, tracts
    "67",                                // units of pixels elsewhere
    "68.",                               // scans of surfaces
    "77.1.5.3",                          // pairs of pictures
    "78.",      "79.",   "80.",  "82.",  // measurements of eyes
    "88.",      "90.",   "91.",          // reports
    "104.",                              // documents, meshes
    "131",      "200.",  "201.",         // displays, settings, inventories
    "481.",                              // radiotherapy, without kRadiotherapyImages
    "501.3",    "501.6",                 // threats, resonances
});
constexpr auto kRadiotherapyImages =
    std::to_array<absl::string_view>({"481.1", "481.2", "481.23", "481.24"});

// Returns the numbers behind kStorage; "" if the class is none of the standard's.
absl::string_view SuffixOf(absl::string_view uid) {
  return absl::ConsumePrefix(&uid, kStandard) && absl::ConsumePrefix(&uid, kStorage)
             ? uid
             : absl::string_view();
}

bool HasPixels(absl::string_view suffix) {
  return absl::c_linear_search(kRadiotherapyImages, suffix) ||
         absl::c_none_of(kWithoutPixels, [suffix](absl::string_view other) {
           return absl::EndsWith(other, ".") ? absl::StartsWith(suffix, other) : suffix == other;
         });
}

}  // namespace

DicomStorage DicomStorageOf(absl::string_view uid) {
  if (absl::c_linear_search(kHardcopies, uid)) {
    return DicomStorage::kImage;
  }
  if (uid == kSiemensNoImage) {
    return DicomStorage::kOther;
  }
  if (!absl::ConsumePrefix(&uid, kStandard)) {
    return DicomStorage::kUnknown;
  }
  return absl::ConsumePrefix(&uid, kStorage) && HasPixels(uid) ? DicomStorage::kImage
                                                               : DicomStorage::kOther;
}

bool IsNuclearStorage(absl::string_view uid) { return SuffixOf(uid) == "20"; }

bool IsDoseStorage(absl::string_view uid) { return SuffixOf(uid) == "481.2"; }

bool IsUltrasoundVolumeStorage(absl::string_view uid) { return SuffixOf(uid) == "6.2"; }

bool IsSecondaryCaptureStorage(absl::string_view uid) {
  const absl::string_view suffix = SuffixOf(uid);
  return suffix == "7" || absl::StartsWith(suffix, "7.");
}

bool IsDirectoryStorage(absl::string_view uid) {
  return absl::ConsumePrefix(&uid, kStandard) && uid == "1.3.10";
}

bool IsSegmentationStorage(absl::string_view uid) {
  const absl::string_view suffix = SuffixOf(uid);
  return suffix == "66.4" || suffix == "66.7";
}

bool IsWholeSlideStorage(absl::string_view uid) { return SuffixOf(uid) == "77.1.6"; }

}  // namespace isoscope::source
