// The groups and arrays of a Zarr store, of either version.

#ifndef ISOSCOPE_CORE_FORMATS_ZARR_ZARR_STORE_H_
#define ISOSCOPE_CORE_FORMATS_ZARR_ZARR_STORE_H_

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/formats/zarr/zarr_json.h"
#include "core/formats/zarr/zarr_metadata.h"
#include "core/source/bytes/object_store.h"

namespace isoscope::source {

// A group, or an array.
struct ZarrNode {
  std::string path{};  // "" for the root
  bool is_array = false;
  ZarrJson attributes = ZarrJson::object();
  // Of an array. An error if it is not one that we read: the node is there, but no volume.
  absl::StatusOr<ZarrArray> array = absl::UnknownError("a group");
};

// Thread-compatible.
class ZarrStore {
 public:
  // The names one level below a path. Not every place can list.
  using List = std::function<absl::StatusOr<std::vector<std::string>>(const std::string& path)>;

  // Reads the metadata of the root, which may hold those of all nodes ("consolidated"): these are
  // taken for what the nodes are. NOT_FOUND: no Zarr store. INVALID_ARGUMENT: damaged metadata.
  static absl::StatusOr<std::unique_ptr<ZarrStore>> Open(std::shared_ptr<const ObjectStore> objects,
                                                         List list);

  // Tells `objects` that Open follows, and Node of the path and of those above it
  // (ObjectStore::Expect). No path is wrong.
  static void ExpectRoot(const ObjectStore& objects, const std::string& path);

  [[nodiscard]] const std::shared_ptr<const ObjectStore>& objects() const { return objects_; }
  // The folder, the file or the address.
  [[nodiscard]] const std::string& name() const { return objects_->name(); }
  // "run.zarr:a/b", or the name of the store.
  [[nodiscard]] std::string NameOf(const std::string& path) const;

  // NOT_FOUND: no node. INVALID_ARGUMENT: damaged metadata, or no path. Of a place that can't list,
  // where each document costs a request, nodes have the version of the root.
  absl::StatusOr<ZarrNode> Node(const std::string& path);
  // Tells that these nodes will be asked for, so that their metadata are fetched at once.
  void Expect(const std::set<std::string>& paths) const;
  // The paths of the nodes one level below a group, as far as the place or consolidated metadata
  // tell, in order. Some may be no nodes. At most 10 000.
  absl::StatusOr<std::vector<std::string>> Children(const std::string& path);

 private:
  ZarrStore(std::shared_ptr<const ObjectStore> objects, List list);

  // The texts of a node's metadata.
  struct Texts {
    std::optional<ZarrJson> v3{};
    std::optional<ZarrJson> array{};
    std::optional<ZarrJson> group{};
    std::optional<ZarrJson> attributes{};
  };
  // consolidated: also gets .zmetadata of the root, if it is not null
  absl::StatusOr<Texts> Read(const std::string& path,
                             absl::StatusOr<std::string>* consolidated = nullptr);
  // Whether consolidated metadata tell what the node is.
  [[nodiscard]] bool IsKnown(const std::string& path) const;
  void TakeConsolidated2(const ZarrJson& metadata);
  void TakeConsolidated3(const ZarrJson& root);

  const std::shared_ptr<const ObjectStore> objects_;
  const List list_;
  // The names of a node's documents, of one version or both.
  std::vector<std::string> documents_;
  std::map<std::string, Texts> consolidated_;  // by path
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ZARR_ZARR_STORE_H_
