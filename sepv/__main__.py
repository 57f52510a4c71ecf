from sepv.cli import main

main()
