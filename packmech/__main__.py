"""`python -m packmech`: the command, where the folder that it was installed in is not searched for commands."""

from packmech.cli import main

if __name__ == "__main__":
    main()
