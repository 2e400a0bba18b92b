// The elements of DICOM files that say where frames lie and what their pixels mean, as GDCM reads
// them. For dicom_child.cc only, which says what leaves the process.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_FRAME_LIST_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_FRAME_LIST_H_

#include <cstddef>
#include <cstdint>
#include <string>

#include "core/formats/dicom/dicom_child.h"
#include "gdcmDataSet.h"
#include "gdcmSequenceOfItems.h"
#include "gdcmSmartPointer.h"
#include "gdcmTag.h"

namespace isoscope::source {

// The bytes of an element; "" if it is not there.
std::string DicomBytesOf(const gdcm::DataSet& data, const gdcm::Tag& tag);

// A number of 16 bits (US); not set if there is none.
MaybeDicomNumber DicomShortOf(const gdcm::DataSet& data, const gdcm::Tag& tag);

// The items of a sequence; null if it is not there.
gdcm::SmartPointer<gdcm::SequenceOfItems> DicomItemsOf(const gdcm::DataSet& data,
                                                       const gdcm::Tag& tag);

// Fills all of `answer` but the outcome, and `count` records of `shared`, kMaxDicomFrames at most.
void ListDicomFrames(const gdcm::DataSet& data, std::size_t count, DicomAnswer* answer,
                     char* shared);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_FRAME_LIST_H_
