// The kernels know a block as a line of samples with a shape; this file ties that to the volume. It
// finds the block's shape and its first sample, and runs the kernels (block_kernels.cc), for labels
// through label_surface.cc. On request it gives each vertex the key of its grid edge in the volume.

#include "core/extract/block_extractor.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "core/base/check.h"
#include "core/extract/block_kernels.h"
#include "core/extract/case_table.h"
#include "core/extract/field_values.h"
#include "core/extract/label_kernels.h"
#include "core/extract/label_surface.h"

namespace isoscope::extract {

using math::Index3;

class BlockExtractor::Impl {
 public:
  Impl(const volume::GridGeometry& geometry, const volume::BlockLayout& layout,
       std::shared_ptr<const BlockShapes> shapes)
      : layout_(layout),
        shapes_(std::move(shapes)),
        to_world_(geometry.world_gradient_from_index()),
        case_table_(GetCaseTable()) {}

  mesh::BlockMeshView Extract(const volume::BlockSamples& samples, double isovalue,
                              bool keeps_gradient_magnitudes, const volume::BlockSamples* field) {
    const Index3 begin = layout_.StoredSamplesOf(samples.block_id).begin;
    ExtractBlock({.type = samples.type,
                  .bytes = samples.bytes,
                  .isovalue = isovalue,
                  .shape = &shapes_->Of(samples.block_id),
                  .begin = {static_cast<double>(begin.x), static_cast<double>(begin.y),
                            static_cast<double>(begin.z)},
                  .to_world = &to_world_,
                  .case_table = &case_table_,
                  .keeps_gradient_magnitudes = keeps_gradient_magnitudes,
                  .field = field},
                 &scratch_);
    return View(samples.block_id, keeps_gradient_magnitudes, field);
  }

  mesh::BlockMeshView ExtractLabels(const volume::BlockSamples& samples,
                                    const volume::InsideRule& rule,
                                    const volume::BlockSamples* field) {
    UseLabels(samples.type, rule);
    ExtractLabelBlock({.samples = &samples,
                       .labels = &label_set_,
                       .shape = &shapes_->Of(samples.block_id),
                       .stored = layout_.StoredSamplesOf(samples.block_id),
                       .own = layout_.OwnSamplesOf(samples.block_id),
                       .to_world = &to_world_,
                       .field = field,
                       .smooths = rule.smooths},
                      &scratch_, &label_scratch_);
    return View(samples.block_id, /*keeps_gradient_magnitudes=*/false, field);
  }

  // Replaces `mesh` by a copy of `view`, the last that was extracted, with edge keys.
  void CopyWithEdgeKeys(const mesh::BlockMeshView& view, mesh::BlockMesh* mesh) const {
    mesh->block_id = view.block_id;
    mesh->owned_vertex_count = view.owned_vertex_count;
    // assign() would copy types with member initialisers one by one.
    mesh->positions.resize(view.positions.size());
    std::ranges::copy(view.positions, mesh->positions.begin());
    mesh->normals.resize(view.normals.size());
    std::ranges::copy(view.normals, mesh->normals.begin());
    mesh->indices.assign(view.indices.begin(), view.indices.end());
    mesh->edge_keys.clear();
    FillEdgeKeys(shapes_->Of(view.block_id), layout_.StoredSamplesOf(view.block_id).begin, mesh);
  }

 private:
  // Makes the set of labels, unless it is that of the last block.
  void UseLabels(volume::ScalarType type, const volume::InsideRule& rule) {
    if (labels_ != rule.labels || label_set_.type != type) {
      label_set_ = MakeLabelSet(type, rule.labels);
      labels_ = rule.labels;
    }
  }

  // The mesh in the scratch space.
  [[nodiscard]] mesh::BlockMeshView View(volume::BlockId block_id, bool keeps_gradient_magnitudes,
                                         const volume::BlockSamples* field) const {
    // The vectors are longer than the mesh: kernels write whole registers.
    mesh::BlockMeshView mesh;
    mesh.block_id = block_id;
    mesh.owned_vertex_count = scratch_.owned_vertex_count;
    mesh.positions = std::span(scratch_.positions).first(scratch_.vertex_count);
    mesh.normals = std::span(scratch_.normals).first(scratch_.vertex_count);
    mesh.indices = std::span(scratch_.indices).first(scratch_.index_count);
    if (field != nullptr && HasWideValues(field->type)) {
      mesh.values = ValuesIn(scratch_.wide_values);
    } else if (keeps_gradient_magnitudes || field != nullptr) {
      mesh.values = ValuesIn(scratch_.values);
    }
    return mesh;
  }

  template <typename T>
  [[nodiscard]] mesh::VertexValues ValuesIn(const std::vector<T>& values) const {
    return mesh::VertexValues(std::span(values).first(scratch_.vertex_count));
  }

  // Adds the key of each vertex's edge: 3 * (index of its lower sample in the volume) + axis.
  // Blocks that share the edge compute the same key.
  void FillEdgeKeys(const BlockShape& shape, const Index3& begin, mesh::BlockMesh* mesh) const {
    const Index3& dims = layout_.sample_dims();
    mesh->edge_keys.reserve(scratch_.vertex_count);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t i = 0; i < scratch_.edge_counts[axis]; ++i) {
        const std::size_t sample = scratch_.edge_samples[axis][i];
        const std::int64_t x = begin.x + static_cast<std::int64_t>(sample % shape.row);
        const std::int64_t y =
            begin.y + static_cast<std::int64_t>(sample % shape.slice / shape.row);
        const std::int64_t z = begin.z + static_cast<std::int64_t>(sample / shape.slice);
        mesh->edge_keys.push_back(3 * (x + dims.x * (y + dims.y * z)) +
                                  static_cast<std::int64_t>(axis));
      }
    }
  }

  const volume::BlockLayout layout_;
  const std::shared_ptr<const BlockShapes> shapes_;
  const math::Mat3d to_world_;
  const CaseTable& case_table_;
  BlockScratch scratch_;
  std::vector<double> labels_;  // those that label_set_ was made of
  LabelSet label_set_;
  LabelScratch label_scratch_;
};

BlockExtractor::BlockExtractor(const volume::GridGeometry& geometry,
                               const volume::BlockLayout& layout)
    : BlockExtractor(geometry, layout, std::make_shared<const BlockShapes>(layout)) {}
BlockExtractor::BlockExtractor(const volume::GridGeometry& geometry,
                               const volume::BlockLayout& layout,
                               std::shared_ptr<const BlockShapes> shapes)
    : impl_(std::make_unique<Impl>(geometry, layout, std::move(shapes))) {}
BlockExtractor::~BlockExtractor() = default;
BlockExtractor::BlockExtractor(BlockExtractor&&) noexcept = default;
BlockExtractor& BlockExtractor::operator=(BlockExtractor&&) noexcept = default;

mesh::BlockMeshView BlockExtractor::Extract(const volume::BlockSamples& samples, double isovalue,
                                            bool keeps_gradient_magnitudes) {
  ISOSCOPE_DCHECK(std::isfinite(isovalue));
  return impl_->Extract(samples, isovalue, keeps_gradient_magnitudes, /*field=*/nullptr);
}

mesh::BlockMeshView BlockExtractor::ExtractWithField(const volume::BlockSamples& samples,
                                                     double isovalue,
                                                     const volume::BlockSamples& field) {
  ISOSCOPE_DCHECK(std::isfinite(isovalue));
  ISOSCOPE_CHECK_EQ(field.block_id, samples.block_id);
  return impl_->Extract(samples, isovalue, /*keeps_gradient_magnitudes=*/false, &field);
}

void BlockExtractor::ExtractWithEdgeKeys(const volume::BlockSamples& samples, double isovalue,
                                         mesh::BlockMesh* mesh) {
  impl_->CopyWithEdgeKeys(Extract(samples, isovalue), mesh);
}

mesh::BlockMeshView BlockExtractor::Extract(const volume::BlockSamples& samples,
                                            const volume::InsideRule& rule,
                                            bool keeps_gradient_magnitudes) {
  if (!rule.has_labels()) {
    return Extract(samples, rule.isovalue, keeps_gradient_magnitudes);
  }
  ISOSCOPE_CHECK(!keeps_gradient_magnitudes);
  return impl_->ExtractLabels(samples, rule, /*field=*/nullptr);
}

mesh::BlockMeshView BlockExtractor::ExtractWithField(const volume::BlockSamples& samples,
                                                     const volume::InsideRule& rule,
                                                     const volume::BlockSamples& field) {
  if (!rule.has_labels()) {
    return ExtractWithField(samples, rule.isovalue, field);
  }
  ISOSCOPE_CHECK_EQ(field.block_id, samples.block_id);
  return impl_->ExtractLabels(samples, rule, &field);
}

void BlockExtractor::ExtractWithEdgeKeys(const volume::BlockSamples& samples,
                                         const volume::InsideRule& rule, mesh::BlockMesh* mesh) {
  impl_->CopyWithEdgeKeys(Extract(samples, rule), mesh);
}

}  // namespace isoscope::extract
