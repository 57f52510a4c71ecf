from sepv.commands import main

main()
