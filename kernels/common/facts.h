// Lists that hold only what a scene has: WHEN(fact, row) is the row where the fact is 1, and nothing where it is 0.
#ifndef FACTS_H
#define FACTS_H

#define WHEN(fact, row)   WHEN_OF(fact, row)
#define WHEN_OF(fact, row) WHEN_##fact(row)
#define WHEN_0(row)
#define WHEN_1(row) row

#endif
