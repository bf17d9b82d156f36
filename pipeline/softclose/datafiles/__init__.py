"""Tables that people bring: text of any program or instrument, read in the one way that fits all of it, or refused.

`read_table` finds encoding, separator, decimal sign and heading together; what asks for the table says which columns it
needs (`Columns`). Nothing is guessed: where two ways of reading fit and give other numbers, neither is taken.
"""

from softclose.datafiles.errors import TableError as TableError
from softclose.datafiles.errors import Unfit as Unfit
from softclose.datafiles.headings import Columns as Columns
from softclose.datafiles.headings import Heading as Heading
from softclose.datafiles.headings import NeededColumn as NeededColumn
from softclose.datafiles.headings import parsed_columns as parsed_columns
from softclose.datafiles.reading import Table as Table
from softclose.datafiles.reading import read_table as read_table
