// isoscope generate FIELD --dims X,Y,Z --output FILE

#ifndef ISOSCOPE_CLIENT_CLI_GENERATE_COMMAND_H_
#define ISOSCOPE_CLIENT_CLI_GENERATE_COMMAND_H_

#include "client-cli/command.h"

namespace isoscope::cli {

Command GenerateCommand();

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_GENERATE_COMMAND_H_
