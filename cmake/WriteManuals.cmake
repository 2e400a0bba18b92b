# Lets the programs write their man pages and completions, below OUTPUT/man/man1 and
# OUTPUT/{bash-completion/completions,zsh/site-functions,fish/vendor_completions.d}. Run by
# cmake -P, at build time:
#
#   cmake -DOUTPUT=share -DPROGRAMS="bin/isoscope;..." -DSERVERS="bin/isoscope-agent;..." -P WriteManuals.cmake

function(write file)
  execute_process(COMMAND ${ARGN} OUTPUT_FILE "${file}" COMMAND_ERROR_IS_FATAL ANY)
endfunction()

set(bash_folder "${OUTPUT}/bash-completion/completions")
set(zsh_folder "${OUTPUT}/zsh/site-functions")
set(fish_folder "${OUTPUT}/fish/vendor_completions.d")
file(REMOVE_RECURSE "${OUTPUT}")
file(MAKE_DIRECTORY "${OUTPUT}/man/man1" "${bash_folder}" "${zsh_folder}" "${fish_folder}")

foreach(program IN LISTS PROGRAMS)
  get_filename_component(name "${program}" NAME)
  execute_process(COMMAND "${program}" --man-pages "${OUTPUT}/man/man1" COMMAND_ERROR_IS_FATAL ANY)
  write("${bash_folder}/${name}" "${program}" completion bash)
  write("${zsh_folder}/_${name}" "${program}" completion zsh)
  write("${fish_folder}/${name}.fish" "${program}" completion fish)
endforeach()
foreach(server IN LISTS SERVERS)
  get_filename_component(name "${server}" NAME)
  write("${OUTPUT}/man/man1/${name}.1" "${server}" --man-page)
  write("${bash_folder}/${name}" "${server}" --completion bash)
  write("${zsh_folder}/_${name}" "${server}" --completion zsh)
  write("${fish_folder}/${name}.fish" "${server}" --completion fish)
endforeach()
file(TOUCH "${OUTPUT}/written")
