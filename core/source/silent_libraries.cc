#include "core/source/silent_libraries.h"

#include <ostream>
#include <streambuf>

#include "itkObject.h"
#include "itkObjectFactory.h"
#include "itkOutputWindow.h"

#include "gdcmTrace.h"

namespace isoscope::source {
namespace {

class SilentWindow final : public itk::OutputWindow {
 public:
  using Self = SilentWindow;
  using Pointer = itk::SmartPointer<Self>;
  itkFactorylessNewMacro(Self);

  void DisplayText(const char* /*text*/) override {}
};

// Drops all that is written to it, and never fails: GDCM takes no other stream.
class Nowhere final : public std::streambuf {
 protected:
  int_type overflow(int_type c) override { return traits_type::not_eof(c); }
};

bool Silence() {
  itk::Object::GlobalWarningDisplayOff();
  itk::OutputWindow::SetInstance(SilentWindow::New());
  // The flags stop the messages at their source. The stream takes those that have no flag.
  static auto* const nowhere = new std::ostream(new Nowhere);  // GDCM may use it to the very end
  gdcm::Trace::DebugOff();
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  gdcm::Trace::SetStream(*nowhere);
  return true;
}

}  // namespace

void SilenceImageLibraries() { [[maybe_unused]] static const bool is_done = Silence(); }

}  // namespace isoscope::source
